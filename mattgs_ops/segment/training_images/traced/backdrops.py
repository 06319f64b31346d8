"""Path-traced desks and grounds without an object, with their cameras, to paint objects on."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.segment.training_images.draw import Camera
from mattgs_ops.segment.training_images.solids import Array

FOCAL = 600 / 640  # of the traced views, over the photo's width
_FLIP = np.diag([1.0, -1.0, -1.0])  # OpenGL's camera axes to OpenCV's


@dataclass(frozen=True, eq=False)
class Backdrop:
    """``image`` [H, W, 3] uint8 RGB; ``pose`` [4, 4] OpenGL camera to world, centimetres.

    ``top`` is the height of what lies at the origin, where the object is to stand.
    """

    image: NDArray[np.uint8]
    pose: Array
    top: float

    def on_canvas(self, side: int) -> NDArray[np.uint8]:
        """Return the image squashed to a square canvas [S, S, 3]."""
        resized: NDArray[np.uint8] = np.asarray(
            cv2.resize(self.image, (side, side), interpolation=cv2.INTER_LINEAR), dtype=np.uint8
        )
        return resized

    def camera(self, side: int, unit: float) -> Camera:
        """Return the canvas's camera in a world of ``unit`` centimetres about the object's foot."""
        height, width = self.image.shape[:2]
        eye = (self.pose[:3, 3] - [0, 0, self.top]) / unit
        scale = FOCAL * side * np.array([1.0, width / height])
        return Camera(_FLIP @ self.pose[:3, :3].T, eye, scale, side, 0.0)


def load_backdrops(folder: Path) -> tuple[Backdrop, ...]:
    """Read what ``render_places`` wrote; raises :class:`InputError` naming a missing image."""
    backdrops = []
    for listing in sorted(folder.glob("place*.json")):
        for name, entry in json.loads(listing.read_text(encoding="utf-8")).items():
            image = cv2.imread(str(folder / "empty" / name))
            if image is None:
                raise InputError(f"{folder / 'empty' / name}: expected a rendered view, found none")
            pose = np.array(entry["pose"], dtype=np.float64)
            backdrops.append(Backdrop(np.ascontiguousarray(image[..., ::-1]), pose, entry["top"]))
    return tuple(backdrops)
