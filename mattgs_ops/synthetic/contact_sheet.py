"""Contact sheets: a capture's photos and masks on one page.

``python -m mattgs_ops.synthetic.contact_sheet CAPTURE_FOLDER SHEET.jpg`` shows every sixth photo
and beneath it the same one with everything but the object darkened.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image as PilImage

from mattgs_ops.errors import InputError
from mattgs_ops.synthetic.surfaces.materials import Image

COLUMNS, EVERY, WIDTH = 4, 6, 320  # thumbnails per row, every which photo, pixels
QUALITY = 85


def contact_sheet(capture: Path) -> Image:
    """Return a page [H, W, 3] uint8; raises :class:`InputError` when no photos are there."""
    photos = sorted((capture / "images").glob("*.jpg"))[::EVERY]
    if not photos:
        raise InputError(f"{capture / 'images'}: expected photos (*.jpg), found none")
    pairs = [_pair(path, capture / "masks" / f"{path.name}.png") for path in photos]
    blank = np.full_like(pairs[0], 255)
    rows = []
    for start in range(0, len(pairs), COLUMNS):
        row = pairs[start : start + COLUMNS]
        rows.append(np.concatenate(row + [blank] * (COLUMNS - len(row)), axis=1))
    return np.concatenate(rows, axis=0)


def _pair(photo: Path, mask: Path) -> Image:
    with PilImage.open(photo) as image, PilImage.open(mask) as cut:
        size = (WIDTH, round(WIDTH * image.height / image.width))
        small = np.asarray(image.convert("RGB").resize(size, PilImage.Resampling.LANCZOS))
        own = np.asarray(cut.convert("L").resize(size, PilImage.Resampling.BOX))
    share = 0.15 + 0.85 * own[..., None].astype(np.float32) / 255
    return np.concatenate([small, np.rint(small * share).astype(np.uint8)], axis=0)


def main(arguments: list[str]) -> None:
    """Write the sheet of one capture; the arguments are its folder and the file to write."""
    if len(arguments) != 2:
        raise SystemExit("usage: python -m mattgs_ops.synthetic.contact_sheet CAPTURE SHEET.jpg")
    page = contact_sheet(Path(arguments[0]))
    PilImage.fromarray(page).save(arguments[1], quality=QUALITY)


if __name__ == "__main__":
    main(sys.argv[1:])
