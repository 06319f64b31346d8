"""Masks that come with photos: which file belongs to which photo, and whether it can be one.

Naming: ``IMG_1.jpg`` has ``IMG_1.jpg.png`` (COLMAP's habit), ``IMG_1.png``, its own name, or
``IMG_1_mask.png`` (Metashape's template for exported masks); other image formats serve as well.
Polarity: 255 = object, 0 = background; an upside-down set is recognised and refused.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.capture.photos import FORMATS, SUFFIXES, UNREADABLE, bit_depth, upright
from mattgs_ops.errors import InputError

THRESHOLD = 128  # values from here on are object
BORDER_SHARE = 0.05  # width of the frame's border that background is expected on
INVERTED_BORDER = 0.5  # more than this share of the border white …
INVERTED_CENTRE = 0.5  # … and less than this share of the middle third: looks upside down
# Of the pixels whose channels say otherwise of the threshold. JPEG colours a few along an outline;
# more than this could be an object (EMPTY_SHARE of a mask report)
COLOURED = 0.002
NOTE = "_mask"  # after a photo's stem, where Metashape's template names the file


class NoMaskError(InputError):
    """A folder of masks has none for a photo."""


def find_mask(folder: Path, photo_name: str) -> Path:
    """Return the mask of a photo in ``folder``: the first that exists of the names it may have.

    PNG goes before the photo's own format, and that before all others. Raises
    :class:`NoMaskError`, which names what to add.
    """
    photo = Path(photo_name)
    stem = photo.with_suffix("").as_posix()  # with the folders that it lies in
    suffixes = dict.fromkeys((".png", photo.suffix, *sorted(SUFFIXES)))
    named = (f"{base}{suffix}" for base in (stem, f"{stem}{NOTE}") for suffix in suffixes)
    for name in (f"{photo_name}.png", *named):
        if (folder / name).is_file():
            return folder / name
    raise NoMaskError(missing_masks(folder, [photo_name]))


def missing_masks(folder: Path, photo_names: Sequence[str]) -> str:
    """Return what to say where photos have no mask in ``folder``; ``photo_names`` is not empty."""
    first = photo_names[0]
    more = f" and {len(photo_names) - 1} more photos" if len(photo_names) > 1 else ""
    stem = Path(first).with_suffix("").as_posix()
    wanted = " or ".join(dict.fromkeys((f"{first}.png", f"{stem}.png")))
    return f"{folder}: no mask for {first}{more}; add {wanted}{', and so on' if more else ''}"


def decode_mask(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """Decode a mask to 0 or 255, [H, W] uint8; raises what :func:`decode_coverage` raises."""
    return binary(decode_coverage(path, size), str(path))


def decode_coverage(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """Decode a mask as it was saved, [H, W] uint8: of 255, the share of a pixel that is object.

    It is turned as its EXIF asks for, as photos are.

    ``size`` is the photo's (width, height), which the mask must have. Raises :class:`InputError`
    for masks that are unreadable, coloured, 16-bit, of another size, empty, or hold 0 and 1.
    """
    try:
        with Image.open(path, formats=FORMATS) as image:
            if bit_depth(path, image) > 8:
                raise InputError(f"{path}: more than 8 bits per channel; save it with 8 bits")
            values = _single_channel(path, upright(image))
    except UNREADABLE as error:
        raise InputError(f"{path}: cannot be read as a mask ({error}); save it again") from error
    found = (values.shape[1], values.shape[0])
    if size is not None and found != size:
        raise InputError(
            f"{path}: the mask is {found[0]}x{found[1]}, its photo {size[0]}x{size[1]} when "
            "upright; save the mask at the photo's size"
        )
    if 0 < int(values.max()) <= 1:
        raise InputError(f"{path}: holds 0 and 1; expected 0 (background) and 255 (object)")
    binary(values, str(path))
    return values


def binary(values: NDArray[np.uint8], where: str) -> NDArray[np.uint8]:
    """Threshold alpha or a grey mask to 0 or 255; raises :class:`InputError` if it is empty."""
    mask = np.where(values >= THRESHOLD, 255, 0).astype(np.uint8)
    if not mask.any():
        raise InputError(
            f"{where}: the mask is empty; expected 255 on the object: mark it or remove the photo"
        )
    return mask


def looks_inverted(mask: NDArray[np.uint8]) -> bool:
    """Say whether the border is mostly object and the middle of the frame mostly background."""
    height, width = mask.shape
    band = max(1, round(BORDER_SHARE * min(height, width)))
    inside = np.zeros(mask.shape, dtype=bool)
    inside[band:-band, band:-band] = True
    centre = mask[height // 3 : -(height // 3) or None, width // 3 : -(width // 3) or None]
    border_white = float((mask[~inside] > 0).mean())
    return border_white > INVERTED_BORDER and float((centre > 0).mean()) < INVERTED_CENTRE


def polarity_problem(inverted: Mapping[str, bool]) -> str | None:
    """Return what to say when most masks (name → looks inverted) are upside down, else None.

    The set is judged as a whole: a single close-up may well fill its border.
    """
    names = sorted(name for name, flag in inverted.items() if flag)
    if 2 * len(names) <= len(inverted):
        return None
    return (
        f"{len(names)} of {len(inverted)} masks look inverted, for example {names[0]}: the border "
        "is mostly white and the middle mostly black; expected 255 = object, 0 = background: "
        "invert them"
    )


def _single_channel(path: Path, image: Image.Image) -> NDArray[np.uint8]:
    if image.has_transparency_data:
        raise InputError(
            f"{path}: a mask with an alpha channel is ambiguous; save it as a grey 8-bit image"
        )
    if image.mode in ("1", "L"):
        return np.asarray(image.convert("L"))
    rgb = image.convert("RGB")
    channels = np.asarray(rgb) >= THRESHOLD
    if float((channels.any(axis=2) & ~channels.all(axis=2)).mean()) > COLOURED:
        raise InputError(f"{path}: a coloured picture; expected a mask of 0 and 255")
    return np.asarray(rgb.convert("L"))
