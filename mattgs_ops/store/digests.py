"""Digests of contents: SHA-256 over bytes, never over paths, times or machines.

Two folders have the same digest when they hold the same relative names with the same bytes.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, 64 hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def list_files(folder: Path) -> dict[str, Path]:
    """Return all files under ``folder`` by relative name with forward slashes, sorted.

    Raises :class:`InputError` for anything that is neither a file nor a folder, links included:
    their contents could change without the digest noticing.
    """
    return dict(sorted(_below(folder, folder, "")))


def _below(folder: Path, place: Path, prefix: str) -> Iterator[tuple[str, Path]]:
    """Yield the files below ``place``; by names, as every stage looks through its inputs."""
    with os.scandir(place) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from _below(folder, place / entry.name, f"{prefix}{entry.name}/")
            elif entry.is_file(follow_symlinks=False):
                yield prefix + entry.name, place / entry.name
            else:
                raise InputError(
                    f"{place / entry.name}: expected plain files and folders only, found a link "
                    "or device"
                )


def folder_digest(folder: Path) -> str:
    """Return the digest of all files under ``folder``."""
    return tree_digest({name: file_digest(path) for name, path in list_files(folder).items()})


def tree_digest(files: Mapping[str, str]) -> str:
    """Return the digest of a tree given as relative name → SHA-256 of the content."""
    return json_digest(dict(files))


def pixels_digest(images: Iterable[tuple[str, NDArray[np.generic]]]) -> str:
    """Return the digest of named images: of their sizes and values, not of how files store them.

    The order in which they come does not count.
    """
    found = {
        name: hashlib.sha256(
            f"{pixels.dtype.str} {pixels.shape}".encode() + np.ascontiguousarray(pixels).tobytes()
        ).hexdigest()
        for name, pixels in images
    }
    return json_digest(found)


def json_digest(value: Any) -> str:
    """Return the digest of a JSON value; the order of keys does not matter.

    Raises TypeError for values that JSON cannot hold (a path never belongs in a key) and
    ValueError for NaN and infinities.
    """
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
