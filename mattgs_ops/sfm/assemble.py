"""From COLMAP's model to a scene's photos, masks and pinhole cameras without distortion."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.formats.colmap_cameras import ColmapCamera
from mattgs_ops.capture.masks import map_folders, read_map
from mattgs_ops.capture.photos import read_rgb, write_png
from mattgs_ops.capture.scene import PreparedCapture, SparsePoints, View
from mattgs_ops.capture.sparse import SparseModel, object_points
from mattgs_ops.capture.undistortion import Lens, Undistortion, undistortion
from mattgs_ops.parallel import over_views
from mattgs_ops.sfm.checks import mask_path, read_mask

Grey = NDArray[np.uint8]
# A distortion that moves no pixel farther than this is not worth a resampling, which blurs.
NEGLIGIBLE_SHIFT = 0.25
GRID = 33  # points per side on which the largest shift is sought


@dataclass(frozen=True)
class PinholeConversion:
    """How one of COLMAP's cameras becomes a pinhole; ``resample`` is None where it is one."""

    lens: Lens
    pinhole: Intrinsics
    resample: Undistortion | None

    def move(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move key points [K, 2] from the photo to the pinhole's photo."""
        if self.resample is None or not len(xy):
            return xy
        new = self.pinhole
        normalised = self.lens.to_plane(xy)
        return np.asarray(normalised * [new.fx, new.fy] + [new.cx, new.cy], dtype=np.float64)


def pinhole_conversion(camera: ColmapCamera) -> PinholeConversion:
    """Decide whether photos of a camera are resampled, and to which pinhole."""
    lens = camera.lens()
    if lens.is_pinhole or largest_shift(lens) <= NEGLIGIBLE_SHIFT:
        return PinholeConversion(lens, lens.intrinsics, None)
    resample = undistortion(lens)
    return PinholeConversion(lens, resample.intrinsics, resample)


def largest_shift(lens: Lens) -> float:
    """Return how far distortion moves the pixel that it moves farthest, in pixels."""
    i = lens.intrinsics
    x, y = np.meshgrid(np.linspace(0, i.width, GRID), np.linspace(0, i.height, GRID))
    pinhole = np.stack([x.ravel(), y.ravel()], axis=1)
    shown = lens.to_pixels((pinhole - [i.cx, i.cy]) / [i.fx, i.fy])
    return float(np.linalg.norm(shown - pinhole, axis=1).max())


def write_views(
    capture: PreparedCapture,
    masks: Path,
    model: SparseModel,
    out: Path,
    soft: Path | None = None,
    *,
    threads: int = 1,
) -> tuple[tuple[View, ...], SparseModel, dict[str, PinholeConversion | None]]:
    """Write photos, masks, coverage, ids and, from ``soft``, saliency as the pinholes see them.

    Returns the scene's views, the model with pinholes, and each view's conversion. Views that were
    not registered keep their place, without a camera; their lens is that of photos of their size,
    None where there is no such photo. ``threads`` write a view each.
    """
    (out / "photos").mkdir(parents=True, exist_ok=True)
    (out / "masks").mkdir(exist_ok=True)
    conversions = {number: pinhole_conversion(camera) for number, camera in model.cameras.items()}
    by_name = {image.name: image for image in model.images.values()}
    sizes = {(p.pinhole.width, p.pinhole.height): p for p in reversed(list(conversions.values()))}
    maps = (
        {}
        if soft is None
        else {one: out / "soft" / one.relative_to(soft) for one in map_folders(soft)}
    )
    used: dict[str, PinholeConversion | None] = {}
    for view in capture.views:
        image = by_name.get(view.photo.name)
        same_size = sizes.get((view.width, view.height))
        used[view.name] = same_size if image is None else conversions[image.camera]

    def write(view: View) -> View:
        conversion, image = used[view.name], by_name.get(view.photo.name)
        camera = None
        if conversion is not None and image is not None:
            camera = Camera(conversion.pinhole, image.rotation, image.translation)
        resample = None if conversion is None else conversion.resample
        return replace(_write_view(view, masks, resample, out, maps), camera=camera)

    views = tuple(over_views(write, capture.views, threads=threads))
    return views, _pinholes(model, conversions), used


def _write_view(
    view: View, masks: Path, lens: Undistortion | None, out: Path, maps: Mapping[Path, Path]
) -> View:
    """Write one view's files as the pinhole sees them, unchanged where there is no lens.

    ``maps`` says for each folder of saliency maps where it is written.
    """
    name = f"{view.name}.png"
    photo, mask = out / "photos" / view.photo.name, out / "masks" / name
    soft_by = ids_by = coverage_by = None
    if lens is None:
        shutil.copyfile(view.photo, photo)
        shutil.copyfile(mask_path(masks, view), mask)
    else:
        soft_by, ids_by, coverage_by = _soft(lens), lens.ids, lens.coverage
        write_png(photo, lens.photo(read_rgb(view.photo)))
        write_png(mask, lens.mask(read_mask(masks, view)))
    for read, written in maps.items():
        _write_map(read / name, soft_by, written / name)
    ids, coverage = view.ids, view.coverage
    if ids is not None:
        ids = _write_map(ids, ids_by, out / "ids" / name)
    if coverage is not None:
        coverage = _write_map(coverage, coverage_by, out / "coverage" / name)
    return replace(view, photo=photo, mask=mask, ids=ids, coverage=coverage)


def write_keypoints(
    found: Path, conversions: Mapping[str, PinholeConversion | None], out: Path
) -> None:
    """Write the worker's key points as pixels of the scene's photos, with the same arrays."""
    with np.load(found) as data:
        arrays = dict(data)
    parts = np.split(arrays["xy"].astype(np.float64), np.cumsum(arrays["counts"])[:-1])
    moved = []
    for name, xy in zip(arrays["names"], parts, strict=True):
        conversion = conversions[str(name)]
        moved.append(xy if conversion is None else conversion.move(xy))
    arrays["xy"] = np.concatenate(moved).astype(np.float32)
    np.savez_compressed(out, **arrays)


def vote(views: tuple[View, ...], model: SparseModel, *, threads: int = 1) -> SparsePoints:
    """Let the masks of the scene's training views vote on every point."""
    numbers = {image.name: number for number, image in model.images.items()}
    cameras, paths = {}, {}
    for view in views:
        # what a training starts from must not know the held-out photos
        if view.split == "train" and view.camera is not None and view.mask is not None:
            number = numbers[view.photo.name]
            cameras[number] = view.camera
            paths[number] = view.mask.parent, view
    masks = over_views(lambda place: read_mask(*place), paths.values(), threads=threads)
    # a view in which nothing was found is dropped, and has no vote
    votes = {number: mask for number, mask in zip(paths, masks, strict=True) if mask.any()}
    return object_points(model, {number: cameras[number] for number in votes}, votes)


def _pinholes(model: SparseModel, conversions: dict[int, PinholeConversion]) -> SparseModel:
    cameras = {}
    for number, conversion in conversions.items():
        i = conversion.pinhole
        cameras[number] = ColmapCamera("PINHOLE", i.width, i.height, (i.fx, i.fy, i.cx, i.cy))
    images = {
        number: replace(image, xy=conversions[image.camera].move(image.xy))
        for number, image in model.images.items()
    }
    return replace(model, cameras=cameras, images=images)


def _write_map(source: Path, resample: Callable[[Grey], Grey] | None, out: Path) -> Path:
    """Write a map of one number a pixel as the pinhole sees it; the same file without a lens."""
    out.parent.mkdir(parents=True, exist_ok=True)
    if resample is None:
        shutil.copyfile(source, out)
        return out
    write_png(out, resample(read_map(source)))
    return out


def _soft(resample: Undistortion) -> Callable[[Grey], Grey]:
    """Resample saliency as photos are."""
    return lambda grey: np.ascontiguousarray(
        resample.photo(np.repeat(grey[..., None], 3, axis=2))[..., 0]
    )
