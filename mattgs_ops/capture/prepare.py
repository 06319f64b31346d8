"""Photos on disk → a prepared capture: validated whole, upright, lossless, the split frozen.

Four kinds are read. **Bundled**: the package's own, with a renderer's exact masks and cameras.
**photos**: a flat folder of photos, or one that holds ``images/``. **nerfstudio**: a
``transforms.json``. **colmap**: ``images/`` and ``sparse/0``. Masks are taken, in this order, from
the folder that the user named, the photos' alpha channel, a frame's ``mask_path``, or ``masks/``
beside the photos.

Everything is checked before anything is written: a photo that a later stage would skip with a log
line, or a split that shifts because a file was dropped, is refused here with all problems at once.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats import PosedPhoto, raise_all, read_colmap, read_nerfstudio
from mattgs_ops.capture.mask_files import (
    binary,
    decode_mask,
    find_mask,
    looks_inverted,
    polarity_problem,
)
from mattgs_ops.capture.photos import Photo, decode, has_exif_rotation, list_photos, on_white
from mattgs_ops.capture.scene import PreparedCapture, Split, View
from mattgs_ops.capture.undistortion import Lens, Undistortion, undistortion
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from mattgs_ops.progress import Progress, no_progress

MINIMUM_PHOTOS = 3  # two for geometry, and one held out
BUNDLED_FOLDER = Path(__file__).resolve().parents[1] / "bundled"
PNG_EFFORT = 1  # zlib level: lossless either way, the fastest that still compresses

Mask = NDArray[np.uint8]
MasksAre = Literal["alpha", "given", "truth", "none"]


@dataclass(frozen=True)
class _Source:
    """What was found under ``root``: photos sorted by name, their poses and masks where known."""

    root: Path
    photos: list[Path]
    posed: dict[str, PosedPhoto]
    cameras_are: Literal["given", "truth", "none"]
    own_masks: Path | None  # the folder that the user named
    masks: Path | None  # the one beside the photos
    ids: Path | None = None  # small structures of some views, from a renderer

    def mask(self, path: Path, photo: Photo) -> Mask | None:
        """Decode the photo's mask, [H, W] of 0 and 255, still distorted; None where it has none."""
        posed = self.posed.get(path.name)
        if self.own_masks is not None:
            return decode_mask(find_mask(self.own_masks, path.name), photo.size)
        if photo.alpha is not None:
            return binary(photo.alpha, f"{path}: alpha")
        if posed is not None and posed.mask is not None:
            return decode_mask(posed.mask, photo.size)
        if self.masks is not None:
            return decode_mask(find_mask(self.masks, path.name), photo.size)
        return None


def prepare(
    capture: CaptureConfig,
    out: Path,
    *,
    test_every: int,
    max_size: int = 1600,
    progress: Progress = no_progress,
) -> PreparedCapture:
    """Validate a capture and write it to ``out`` as later stages read it.

    Every ``test_every``-th photo by sorted file name, the first included, is a test view. Lens
    distortion that came with the cameras is removed. Photos whose longer side exceeds ``max_size``
    pixels are reduced with an area filter, intrinsics with them. Transparent photos are composited
    on white; masks are 0 or 255, alpha counts as object from 128. Progress counts each photo
    twice, once checked and once written. Raises :class:`InputError` that lists every problem
    found; nothing has been written then.
    """
    source = _open(capture)
    masks_are = _check(source, progress)
    if capture.path is None and capture.masks is None:
        masks_are = "truth"
    out = out.resolve()
    (out / "photos").mkdir(parents=True, exist_ok=True)
    if masks_are != "none":
        (out / "masks").mkdir(exist_ok=True)
    total = len(source.photos)
    views, lenses = [], dict[Lens, Undistortion]()
    for index, path in enumerate(source.photos):
        split: Split = "test" if index % test_every == 0 else "train"
        views.append(_write_view(path, source, split, max_size, out, lenses))
        progress(total + index + 1, 2 * total, f"{path.name} prepared")
    prepared = PreparedCapture(capture.name, out, tuple(views), masks_are, source.cameras_are)
    prepared.save()
    return prepared


def _open(capture: CaptureConfig) -> _Source:
    """Find photos, poses and masks; raises :class:`InputError` on what is missing."""
    if capture.masks is not None and not capture.masks.is_dir():
        raise InputError(f"{capture.masks}: expected a folder of masks, found none")
    if capture.path is None:
        root = BUNDLED_FOLDER / capture.name
        if not (root / "transforms.json").is_file():
            raise InputError(f"{root}: the bundled capture is missing; reinstall the package")
        posed = {photo.photo.name: photo for photo in read_nerfstudio(root)}
        photos = [photo.photo for photo in posed.values()]
        return _Source(root, photos, posed, "truth", capture.masks, root / "masks", root / "ids")
    root = capture.path
    if not root.is_dir():
        found = "a file" if root.is_file() else "nothing"
        raise InputError(f"{root}: expected a folder of photos, found {found}")
    kind = _detect(root) if capture.kind == "auto" else capture.kind
    if kind == "nerfstudio":
        posed = {photo.photo.name: photo for photo in read_nerfstudio(root)}
        photos = [photo.photo for photo in posed.values()]
        return _Source(root, photos, posed, "given", capture.masks, _mask_folder(root))
    images = root / "images" if (root / "images").is_dir() else root
    photos, problems = list_photos(images, capture.masks)
    if images != root:
        problems += _beside(root, images)
    raise_all(problems)
    masks = _mask_folder(root, images)
    if kind == "photos":
        return _Source(images, photos, {}, "none", capture.masks, masks)
    model = root / "sparse" / "0" if (root / "sparse" / "0").is_dir() else root / "sparse"
    posed = {photo.photo.name: photo for photo in read_colmap(model, images)}
    return _Source(images, photos, posed, "given", capture.masks, masks)


def _detect(root: Path) -> Literal["photos", "nerfstudio", "colmap"]:
    if (root / "transforms.json").is_file():
        return "nerfstudio"
    if any((root / "sparse").glob("**/cameras.*")):
        return "colmap"
    return "photos"


def _mask_folder(*beside: Path) -> Path | None:
    return next((f / "masks" for f in beside if (f / "masks").is_dir()), None)


def _beside(root: Path, images: Path) -> list[str]:
    loose, _ = list_photos(root)
    if not loose:
        return []
    return [f"{loose[0]}: {len(loose)} photos lie beside {images}; move all into one folder"]


def _check(source: _Source, progress: Progress) -> MasksAre:
    """Decode everything once and say whose masks there are; raises with all problems."""
    found, total = len(source.photos), len(source.photos)
    if found < MINIMUM_PHOTOS:
        raise InputError(
            f"{source.root}: found {found} photos; at least {MINIMUM_PHOTOS} are needed to find "
            "the cameras, and 30 or more from all sides for a good model: add photos"
        )
    problems: list[str] = []
    sizes: dict[str, tuple[int, int]] = {}
    inverted: dict[str, bool] = {}
    alpha = False
    for index, path in enumerate(source.photos):
        try:
            photo = decode(path)
            sizes[path.name] = photo.size
            alpha = alpha or photo.alpha is not None
            problems += _camera_problems(path, photo, source.posed.get(path.name))
            mask = source.mask(path, photo)
            if mask is not None:
                inverted[path.name] = looks_inverted(mask)
        except InputError as error:
            problems.append(str(error))
        progress(index + 1, 2 * total, f"{path.name} checked")
    problems += _size_problems(source, sizes)
    upside_down = polarity_problem(inverted)
    unmasked = sorted(set(sizes) - set(inverted))
    if upside_down is not None:
        problems.append(upside_down)
    elif inverted and unmasked and not problems:
        problems.append(
            f"{unmasked[0]}: {len(unmasked)} of {total} photos have no mask or transparency while "
            "the others have; mask all photos or none"
        )
    raise_all(problems)
    if not inverted:
        return "none"
    return "alpha" if alpha and source.own_masks is None else "given"


def _camera_problems(path: Path, photo: Photo, posed: PosedPhoto | None) -> list[str]:
    if posed is None:
        return []
    problems = []
    if has_exif_rotation(path):
        problems.append(
            f"{path}: turned by its EXIF orientation, and which way up its camera means is not "
            "known; save the photo upright without orientation, with the camera for it"
        )
    given = (posed.lens.intrinsics.width, posed.lens.intrinsics.height)
    if photo.size != given:
        problems.append(
            f"{path}: the photo is {_by(photo.size)}, its camera says {_by(given)}; give the "
            "intrinsics of these photos, or the photos of these intrinsics"
        )
    return problems


def _size_problems(source: _Source, sizes: dict[str, tuple[int, int]]) -> list[str]:
    """Name the photos whose upright size differs from the most common one."""
    if len(set(sizes.values())) < 2:
        return []
    (usual, count), *_ = Counter(sizes.values()).most_common(1)
    problems = []
    for path in source.photos:
        size = sizes.get(path.name, usual)
        if size == usual:
            continue
        others = f"{count} of {len(sizes)} photos are {_by(usual)}"
        if size == usual[::-1]:
            problems.append(
                f"{path}: {_by(size)}, another orientation: {others}; turn or remove it"
            )
        else:
            problems.append(f"{path}: {_by(size)}, another size: {others}; resize or remove it")
    return problems


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _write_view(
    path: Path,
    source: _Source,
    split: Split,
    max_size: int,
    out: Path,
    lenses: dict[Lens, Undistortion],
) -> View:
    """Write one photo and its mask; ``lenses`` keeps the maps of lenses already seen."""
    photo = decode(path)
    rgb, mask = on_white(photo), source.mask(path, photo)
    camera, posed = None, source.posed.get(path.name)
    if posed is not None:
        intrinsics = posed.lens.intrinsics
        if not posed.lens.is_pinhole:
            if posed.lens not in lenses:
                lenses[posed.lens] = undistortion(posed.lens)
            intrinsics = lenses[posed.lens].intrinsics
            rgb = lenses[posed.lens].photo(rgb)
            mask = None if mask is None else lenses[posed.lens].mask(mask)
        camera = Camera(intrinsics, posed.rotation, posed.translation)
    size = _reduced(photo.size, max_size)
    if size != photo.size:
        camera = None if camera is None else camera.scaled(*size)
        rgb = _area(rgb, size)
        mask = None if mask is None else binary(_area(mask, size), f"{path}: reduced mask")
    file = f"{path.name}.png"
    Image.fromarray(rgb).save(out / "photos" / file, compress_level=PNG_EFFORT)
    if mask is not None:
        Image.fromarray(mask).save(out / "masks" / file, compress_level=PNG_EFFORT)
    mask_path = None if mask is None else out / "masks" / file
    ids = _write_ids(source, file, size, out)
    return View(path.name, split, *size, out / "photos" / file, mask_path, camera, ids)


def _write_ids(source: _Source, file: str, size: tuple[int, int], out: Path) -> Path | None:
    """Copy what the renderer knows of a view's small structures, where it does."""
    if source.ids is None or not (source.ids / file).is_file():
        return None
    path = out / "ids" / file
    path.parent.mkdir(exist_ok=True)
    with Image.open(source.ids / file) as ids:
        ids.resize(size, Image.Resampling.NEAREST).save(path, compress_level=PNG_EFFORT)
    return path


def _reduced(size: tuple[int, int], max_size: int) -> tuple[int, int]:
    """Return the size with its longer side at most ``max_size``, never enlarged."""
    if max(size) <= max_size:
        return size
    width, height = (max(1, round(side * max_size / max(size))) for side in size)
    return width, height


def _area(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Reduce by the mean over each new pixel's area."""
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
