"""Everything that can be wrong with photos and masks, found before the first key point is sought.

COLMAP skips or misreads such files with one line in its log or none.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError
from mattgs_ops.parallel import over_views

FEWEST_PHOTOS = 3  # two views fix no scale drift and leave nothing to hold out
MOST_NAMED = 5  # problems told in one message


def check(capture: PreparedCapture, masks: Path, *, threads: int = 1) -> list[str]:
    """Check photos and masks; returns the names of views whose mask is empty.

    Raises :class:`InputError` naming each file with what was expected and found: fewer than three
    photos, unreadable files, 16-bit or grey photos, masks that are missing, of another size, not
    made of 0 and 255, or empty in every view.
    """
    if len(capture.views) < FEWEST_PHOTOS:
        raise InputError(
            f"{capture.folder}: expected at least {FEWEST_PHOTOS} photos, "
            f"found {len(capture.views)}"
        )

    def black_or_wrong(view: View) -> bool | InputError:
        try:
            _check_photo(view)
            return not read_mask(masks, view).any()
        except InputError as error:
            return error

    found = over_views(black_or_wrong, capture.views, threads=threads)
    problems = [str(one) for one in found if isinstance(one, InputError)]
    empty = [v.name for v, one in zip(capture.views, found, strict=True) if one is True]
    if problems:
        more = len(problems) - MOST_NAMED
        tail = [f"… and {more} more"] if more > 0 else []
        raise InputError("\n".join(problems[:MOST_NAMED] + tail))
    if len(empty) == len(capture.views):
        raise InputError(
            f"{masks}: all {len(empty)} masks are black; expected 255 on the object's pixels"
        )
    return empty


def keeps_poses(capture: PreparedCapture, config: SfmConfig) -> bool:
    """Say whether cameras that came with the capture are taken as they are."""
    return capture.cameras_are == "given" and config.poses == "auto"


def check_given_cameras(capture: PreparedCapture, least: float) -> None:
    """Raise :class:`InputError` where fewer than ``least``, a share, of the views have a camera."""
    without = [view.name for view in capture.views if view.camera is None]
    posed = len(capture.views) - len(without)
    if posed < least * len(capture.views):
        named = ", ".join(without[:MOST_NAMED]) + (", …" if len(without) > MOST_NAMED else "")
        raise InputError(
            f"capture {capture.name}: expected cameras of at least {least:.0%} of the photos "
            f"(sfm.min_registered), found {posed} of {len(capture.views)}; without one: {named}. "
            'Remove those photos, or set sfm.poses = "estimate" to find all cameras anew'
        )


def mask_path(masks: Path, view: View) -> Path:
    """Return where a view's mask lies in a folder of masks."""
    return masks / f"{view.name}.png"


def read_mask(masks: Path, view: View) -> NDArray[np.uint8]:
    """Read a view's mask, [H, W] uint8 of 0 and 255; raises :class:`InputError`."""
    path = mask_path(masks, view)
    if not path.is_file():
        raise InputError(f"{path}: expected the mask of {view.name}, found no file")
    mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if mask is None or mask.dtype != np.uint8 or mask.ndim != 2:
        found = "no readable image" if mask is None else f"{mask.dtype} {mask.shape}"
        raise InputError(f"{path}: expected an 8-bit grey mask, found {found}")
    if mask.shape != (view.height, view.width):
        raise InputError(
            f"{path}: expected the photo's size {view.width}x{view.height}, found "
            f"{mask.shape[1]}x{mask.shape[0]}"
        )
    between = mask[(mask > 0) & (mask < 255)]
    if len(between):
        raise InputError(f"{path}: expected only 0 and 255, found {between.min()}")
    return np.asarray(mask, dtype=np.uint8)


def _check_photo(view: View) -> None:
    photo = cv2.imread(str(view.photo), cv2.IMREAD_UNCHANGED) if view.photo.is_file() else None
    if photo is None or photo.dtype != np.uint8 or photo.ndim != 3 or photo.shape[2] != 3:
        found = "no readable image" if photo is None else f"{photo.dtype} {photo.shape}"
        raise InputError(f"{view.photo}: expected an 8-bit RGB photo, found {found}")
    if photo.shape[:2] != (view.height, view.width):
        raise InputError(
            f"{view.photo}: expected {view.width}x{view.height} pixels, found "
            f"{photo.shape[1]}x{photo.shape[0]}"
        )
