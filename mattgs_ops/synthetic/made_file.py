"""How the images of a folder were made, as JSON beside them, written before the first of them.

Images that lie in a folder are kept by their names. Whoever goes on with them asks here first, so
that those of other settings are neither mixed with the ones asked for nor taken for them.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from mattgs_ops.whole_file import write_text_whole

FILE = "made.json"


def write_made(path: Path, made: Mapping[str, object]) -> None:
    """Write what images are made with, whole or not at all."""
    write_text_whole(path, json.dumps(made) + "\n")


def check_same(path: Path, made: Mapping[str, object], what: str) -> None:
    """Raise :class:`InputError`, naming what differs, where the file tells of another making.

    ``what`` was made is for the message; what else the file holds is of no concern.
    """
    if not path.is_file():
        return
    before = _read(path)
    other = [key for key in made if key not in before or before[key] != made[key]]
    if other:
        raise InputError(
            f"{path}: expected {what} made with {_told(made, other)}, found {_told(before, other)}"
        )


def check_folder(folder: Path, made: Mapping[str, object]) -> None:
    """Raise :class:`InputError` for a folder whose images are not known to be made like this.

    That is one whose ``made.json`` differs, and one that has files but no ``made.json``.
    """
    check_same(folder / FILE, made, "images")
    if (folder / FILE).is_file():
        return
    for path in folder.rglob("*"):
        if path.is_file() and path.suffix != ".part":  # what a killed process was writing
            raise InputError(
                f"{folder}: expected {FILE} beside the images, to tell what they were made with, "
                f"found {path.relative_to(folder)} without it; give the images another folder"
            )


def _read(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # not UTF-8, not JSON
        raise InputError(f"{path}: expected JSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected a table, found {type(data).__name__}")
    return data


def _told(made: Mapping[str, object], keys: list[str]) -> str:
    return ", ".join(f"{key} {made.get(key)!r}" for key in keys)
