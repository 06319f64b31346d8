"""Photos as training and evaluation see them: resized, composited, 8-bit, with their camera.

A photo is shrunk by an exact area filter (each new pixel is the mean of the old ones it covers)
until its longest side is the wanted resolution, never enlarged. For ``nobg`` the object is put on
white at full size first, ``photo * mask + white * (1 - mask)``, and the composite is shrunk, so
that a pixel on the edge is the right mixture. Values are rounded to 8 bits, as they would be in
a file: what training sees, evaluation compares with.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import read_map
from mattgs_ops.capture.photos import read_rgb
from mattgs_ops.capture.scene import View
from mattgs_ops.config import TrainConfig
from mattgs_ops.errors import InputError
from mattgs_ops.frozen import Background
from mattgs_ops.splat.memory import Memory

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

Colour = tuple[float, float, float]
WHITE = (1.0, 1.0, 1.0)
BLACK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TrainingView:
    """One photo at training size.

    ``image`` [H, W, 3] float32 in [0, 1], multiples of 1/255, sRGB as stored; ``mask`` [H, W]
    float32 in [0, 1], the share of each pixel that is object (all 1 where a view has no mask);
    ``camera`` for these H × W pixels.
    """

    name: str
    camera: Camera
    image: Floats
    mask: Floats


@dataclass(frozen=True)
class StoredView:
    """A :class:`TrainingView` kept in memory at 8 bits: 4 bytes per pixel.

    ``image`` [H, W, 3] and ``mask`` [H, W] uint8; ``photo`` [H, W, 3] uint8 is the photo before
    compositing, or the same array as ``image`` where nothing was composited.
    """

    name: str
    camera: Camera
    image: Bytes
    mask: Bytes
    photo: Bytes


def size_at(width: int, height: int, resolution: int) -> tuple[int, int]:
    """Return (width, height) with the longest side at most ``resolution`` pixels."""
    scale = min(1.0, resolution / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def load_view(view: View, background: Background, resolution: int) -> TrainingView:
    """Read one view for training or scoring.

    ``resolution`` is the longest side in pixels. Raises :class:`InputError` naming the file when
    it cannot be read or has another size than the scene says, when the view has no camera, and
    when ``nobg`` is wanted of a view without a mask.
    """
    stored = store_view(view, background, resolution)
    return TrainingView(
        stored.name,
        stored.camera,
        stored.image.astype(np.float32) / np.float32(255),
        stored.mask.astype(np.float32) / np.float32(255),
    )


def camera_at(view: View, resolution: int) -> Camera:
    """Return the camera of a registered view at a longest side of ``resolution`` pixels.

    Raises :class:`InputError` for a view without one.
    """
    if view.camera is None:
        raise InputError(f"view {view.name}: expected a camera, found none (not registered)")
    return view.camera.scaled(*size_at(view.width, view.height, resolution))


def store_view(view: View, background: Background, resolution: int) -> StoredView:
    """Read one view as :func:`load_view` does, at 8 bits; raises the same errors."""
    camera = camera_at(view, resolution)
    photo = _sized(read_rgb(view.photo), view.photo, view)
    size = size_at(view.width, view.height, resolution)
    plain = _shrink(photo.astype(np.float32), size)
    if view.mask is None:
        if background == "nobg":
            raise InputError(f"view {view.name}: `nobg` needs a mask, found none")
        opaque = np.full(plain.shape[:2], 255, np.uint8)
        return StoredView(view.name, camera, plain, opaque, plain)
    mask = _sized(read_map(view.mask), view.mask, view).astype(np.float32)
    image = _shrink(_on_white(photo, mask), size) if background == "nobg" else plain
    return StoredView(view.name, camera, image, _shrink(mask, size), plain)


def load_truth(view: View, background: Background, resolution: int) -> TrainingView:
    """Read one view as it is scored: like :func:`load_view`, with the exact mask where known.

    The object of ``nobg`` is put on white by its coverage, and the mask is the coverage. A photo
    that shows the object on white already is its own truth.
    """
    if view.coverage is None:
        return load_view(view, background, resolution)
    exact = replace(view, mask=view.coverage)
    return load_view(exact, "original" if view.cut_out else background, resolution)


def store_views(views: Iterable[View], background: Background, resolution: int) -> list[StoredView]:
    """Read views into memory, 4 bytes per pixel (7 for ``nobg``); same errors."""
    return [store_view(view, background, resolution) for view in views]


def background_colour(config: TrainConfig) -> Colour:
    """Return the colour behind the splats when they are shown; ``random`` is shown on white."""
    return BLACK if config.background == "black" else WHITE


def recolour(image: Floats, mask: Floats, colour: Colour) -> Floats:
    """Change the white behind a ``nobg`` image into ``colour``.

    ``image`` [H, W, 3] is ``object * mask + 1 - mask``; the result is
    ``object * mask + colour * (1 - mask)``, in [0, 1] but for rounding.
    """
    missing = np.float32(1) - np.asarray(colour, dtype=np.float32)
    changed: Floats = image - missing * (1 - mask[:, :, None])
    return np.clip(changed, np.float32(0), np.float32(1))


def _sized(pixels: Bytes, path: Path, view: View) -> Bytes:
    """Return the pixels that were read from ``path`` if they have the view's size."""
    if pixels.shape[:2] != (view.height, view.width):
        found = f"{pixels.shape[1]} x {pixels.shape[0]}"
        raise InputError(f"{path}: expected {view.width} x {view.height} pixels, found {found}")
    return pixels


def _on_white(photo: Bytes, mask: Floats) -> Floats:
    """Return ``photo * mask + 255 * (1 - mask)``, [H, W, 3]; ``mask`` [H, W] is in [0, 255]."""
    # three channels and no new arrays: a third of the time that broadcasting one channel takes
    share: Floats = cv2.merge([mask, mask, mask])
    share /= np.float32(255)
    image: Floats = photo * share
    np.subtract(np.float32(1), share, out=share)
    share *= np.float32(255)
    image += share
    return image


def _shrink(values: Floats, size: tuple[int, int]) -> Bytes:
    if (values.shape[1], values.shape[0]) != size:
        values = cv2.resize(values, size, interpolation=cv2.INTER_AREA)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def unit_range(values: Bytes, memory: Memory | None = None) -> Tensor:
    """Return bytes as float32 in [0, 1]; in ``memory``, overwriting the last call's, if given."""
    stored = torch.from_numpy(values)
    out = (
        torch.empty(stored.shape, dtype=torch.float32)
        if memory is None
        else memory.take("unit", *stored.shape)
    )
    return torch.div(stored, 255, out=out)
