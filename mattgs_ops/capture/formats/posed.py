"""What readers of captures with cameras return, and what all of them refuse."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.photos import SIDEWAYS, UPRIGHT, exif_orientation
from mattgs_ops.capture.scene import Split
from mattgs_ops.capture.undistortion import Lens
from mattgs_ops.errors import InputError

MOST_LISTED = 20  # problems told in one message


@dataclass(frozen=True)
class PosedPhoto:
    """A photo's file with its lens and pose (``x_cam = rotation @ x + translation``)."""

    photo: Path
    lens: Lens
    rotation: NDArray[np.float64]  # [3, 3]
    translation: NDArray[np.float64]  # [3]
    mask: Path | None = None


@dataclass(frozen=True)
class PosedCapture:
    """Photos with cameras, sorted by file.

    ``split`` says of each photo's file which view it is, where the capture says so; it is empty
    otherwise. ``left_out`` are photos that a capture with a split puts into neither part.
    ``points`` is a point cloud's file or a COLMAP model's folder, in the cameras' world. ``read``
    are the files that said all this.
    """

    photos: tuple[PosedPhoto, ...]
    split: Mapping[Path, Split] = field(default_factory=dict)
    left_out: tuple[Path, ...] = ()
    points: Path | None = None
    read: tuple[Path, ...] = ()


def is_as_stored(path: Path, upright: tuple[int, int], posed: PosedPhoto | None) -> bool:
    """Say whether a photo's camera is of its pixels as stored, which EXIF asks to turn.

    So it is where COLMAP ran on photos that a phone took on its side: it does not turn them.
    ``upright`` is the size (width, height) once turned.
    """
    if posed is None or upright[0] == upright[1]:
        return False
    stored = posed.lens.intrinsics.height, posed.lens.intrinsics.width
    return upright == stored and exif_orientation(path) in SIDEWAYS


def camera_problems(path: Path, size: tuple[int, int], posed: PosedPhoto | None) -> list[str]:
    """Say why a photo of this size (width, height) cannot be the one that its camera is of.

    The size is of the pixels as they are used, turned or as stored.
    """
    if posed is None:
        return []
    problems = []
    given = (posed.lens.intrinsics.width, posed.lens.intrinsics.height)
    orientation = exif_orientation(path)
    # a photo on its side whose size tells which way up its camera means
    clear = orientation in SIDEWAYS and size == given and given[0] != given[1]
    if orientation != UPRIGHT and not clear:
        problems.append(
            f"{path}: turned by its EXIF orientation, and which way up its camera means is not "
            "known; save the photo upright without orientation, with the camera for it"
        )
    if size != given:
        problems.append(
            f"{path}: the photo is {_by(size)}, its camera says {_by(given)}; give the "
            "intrinsics of these photos, or the photos of these intrinsics"
        )
    return problems


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def path_inside(folder: Path, name: str, where: str) -> Path:
    """Return ``folder / name``; raises :class:`InputError` when that leads out of ``folder``.

    File names in a capture come from whoever made it, and must not name any other file of this
    machine. Links that lie in the folder are followed: who put them there chose where they lead.
    """
    path = folder / name
    inside = os.path.normpath(folder)
    if os.path.commonpath([inside, os.path.normpath(path)]) != inside or "\0" in name:
        raise InputError(
            f"{where}: {name!r} leads out of {folder}; move the file into the capture's folder"
        )
    return path


def raise_all(problems: Sequence[str], limit: int = MOST_LISTED) -> None:
    """Raise one :class:`InputError` that lists all problems (the first ``limit``), if any."""
    if not problems:
        return
    lines = list(problems[:limit])
    if len(problems) > limit:
        lines.append(f"… and {len(problems) - limit} more")
    raise InputError("\n".join(lines))
