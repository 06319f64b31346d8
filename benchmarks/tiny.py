"""The smallest real benchmark, a file and photos, for programs that try what surrounds it."""

import shutil
from pathlib import Path

from PIL import Image

import mattgs_ops

CONFIG = Path(__file__).with_name("tiny.toml")
PHOTOS = Path(mattgs_ops.__file__).parent / "bundled" / "lattepanda" / "images"
VIEWS = 8  # neighbours on one orbit
SIZE = (480, 360)


def write(folder: Path) -> Path:
    """Write photos and configuration into ``folder``; return the configuration's path."""
    photos = folder / "photos"
    photos.mkdir(parents=True, exist_ok=True)
    for path in sorted(PHOTOS.glob("*.jpg"))[:VIEWS]:
        with Image.open(path) as photo:
            photo.resize(SIZE).save(photos / path.name, quality=95)
    return Path(shutil.copy(CONFIG, folder))
