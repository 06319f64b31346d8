"""What a photo's EXIF tells of its camera: which one it is, and its focal length in pixels.

The focal length starts structure-from-motion, which estimates it. As in COLMAP it is that of the
35 mm equivalent; where there is none, that of the lens on the sensor, whose size the resolution in
the focal plane tells (EXIF 2.32, tags 41486 to 41488). Canon's cameras write only the latter.
"""

import math
from collections.abc import Mapping
from typing import Any

from PIL import ExifTags, Image

FILM_DIAGONAL = math.hypot(36.0, 24.0)  # mm, of the film that 35 mm equivalents refer to
# Shares of the longest side: COLMAP's min_ and max_focal_length_ratio, outside which it places none
FOCAL_SHARES = (0.1, 10.0)
SAME_SHAPE = 0.02  # difference of aspect ratios that rounding of pixels explains
INCH = 2
MILLIMETRES = {INCH: 25.4, 3: 10.0}  # of the unit that resolutions refer to


def exif_focal(exif: Image.Exif, size: tuple[int, int]) -> float | None:
    """Return the focal length in pixels of a photo of ``size`` (width, height) as stored.

    None where EXIF tells none, or one outside ``FOCAL_SHARES``, and where it says that the photo
    was cut to another shape after it was taken.
    """
    details = exif.get_ifd(ExifTags.IFD.Exif)
    try:
        taken = [
            float(details.get(tag, side))
            for tag, side in zip(
                (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight), size, strict=True
            )
        ]
        share = _by_equivalent(details, size) or _by_sensor(details, max(taken))
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    if not (share and min(taken) > 0):
        return None
    # some programs turn the pixels and leave EXIF as it was
    if abs(max(taken) / min(taken) - max(size) / min(size)) > SAME_SHAPE:
        return None
    shortest, longest = FOCAL_SHARES
    return share * max(size) if shortest <= share <= longest else None


def exif_lens(exif: Image.Exif) -> str:
    """Return what tells a photo's camera from others: its name, and its focal length in mm."""
    length = exif.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.FocalLength)
    named = (exif.get(ExifTags.Base.Make), exif.get(ExifTags.Base.Model))
    told = [str(text).strip("\0 ") for text in named if text]
    return " ".join([*told, *([] if length is None else [f"{length} mm"])])


def _by_equivalent(details: Mapping[int, Any], size: tuple[int, int]) -> float:
    """Return the 35 mm equivalent, which goes by the diagonal, as a share of the longest side."""
    equivalent = float(details.get(ExifTags.Base.FocalLengthIn35mmFilm, 0))
    return equivalent * math.hypot(*size) / (FILM_DIAGONAL * max(size))


def _by_sensor(details: Mapping[int, Any], longest: float) -> float:
    """Return the focal length on the sensor as a share of its longest side of so many pixels."""
    focal = float(details.get(ExifTags.Base.FocalLength, 0))  # mm
    resolution = float(details.get(ExifTags.Base.FocalPlaneXResolution, 0))  # pixels per unit
    unit = MILLIMETRES.get(int(details.get(ExifTags.Base.FocalPlaneResolutionUnit, INCH)), 0.0)
    return focal * resolution / (unit * longest) if unit else 0.0
