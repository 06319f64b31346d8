"""Photos on disk → a prepared capture: validated whole, upright, lossless, the split frozen.

``source.py`` says which photos, cameras and masks there are; here they are decoded, checked and
written. Masks are taken, in this order, from the folder that the user named, the photos' alpha
channel, a frame's ``mask_path``, or ``masks/`` beside the photos. A split that came with the
capture is kept; otherwise every so-many-th photo by name is held out.

Everything is checked before anything is written: a photo that a later stage would skip with a log
line, or a split that shifts because a file was dropped, is refused here with all problems at once.
Photos may differ in size and orientation; later stages give each size a camera of its own.
"""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.point_cloud import read_points
from mattgs_ops.capture.formats.posed import camera_problems, is_as_stored, raise_all
from mattgs_ops.capture.mask_files import (
    NoMaskError,
    binary,
    decode_coverage,
    find_mask,
    looks_inverted,
    missing_masks,
    polarity_problem,
)
from mattgs_ops.capture.photos import (
    Photo,
    decode,
    on_white,
    write_png,
)
from mattgs_ops.capture.scene import POINTS_FILE, GivenPoints, PreparedCapture, Split, View
from mattgs_ops.capture.source import Source, SourcePhoto, is_video, open_source, view_name
from mattgs_ops.capture.undistortion import Undistortions
from mattgs_ops.capture.video import extract_frames
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from mattgs_ops.parallel import each_view
from mattgs_ops.progress import Progress, no_progress

MINIMUM_PHOTOS = 3  # two for geometry, and one held out

Mask = NDArray[np.uint8]
MasksAre = Literal["alpha", "given", "truth", "none"]


def prepare(
    capture: CaptureConfig,
    out: Path,
    *,
    test_every: int,
    max_size: int = 1600,
    threads: int = 1,
    progress: Progress = no_progress,
) -> PreparedCapture:
    """Validate a capture and write it to ``out`` as later stages read it.

    Where the capture has no split of its own, every ``test_every``-th photo by sorted name, the
    first included, is a test view. Lens distortion that came with the cameras is removed. Photos
    whose longer side exceeds ``max_size`` pixels are reduced with an area filter, intrinsics with
    them. Transparent photos are composited on white; masks are 0 or 255, alpha counts as object
    from 128; what they were before that threshold is written beside them, as coverage. Progress
    counts each photo twice, once checked and once written. Raises :class:`InputError` that lists
    every problem found; nothing has been written then.
    """
    with _opened(capture, progress) as source:
        masks_are = _check(source, threads, progress)
        points = None if source.points is None else _points(source, source.points)
        if capture.path is None and capture.masks is None:
            masks_are = "truth"
        out = out.resolve()
        total = len(source.photos)
        splits = [
            source.split.get(photo.path, "test" if index % test_every == 0 else "train")
            for index, photo in enumerate(source.photos)
        ]
        write = partial(
            _write_view, source=source, max_size=max_size, out=out, lenses=Undistortions()
        )
        views = []
        for view in each_view(write, source.photos, splits, threads=threads):
            views.append(view)
            progress(total + len(views), 2 * total, f"{view.name} prepared")
    if points is not None:
        points.save(out / POINTS_FILE)
    prepared = PreparedCapture(
        capture.name,
        out,
        tuple(views),
        masks_are,
        source.cameras_are,
        split_is="given" if source.split else "every",
        left_out=tuple(path.name for path in source.left_out),
    )
    prepared.save()
    return prepared


@contextmanager
def _opened(capture: CaptureConfig, progress: Progress) -> Iterator[Source]:
    """Open a capture's source; a video's frames lie in a temporary folder meanwhile."""
    if not is_video(capture):
        yield open_source(capture)
        return
    assert capture.path is not None
    with tempfile.TemporaryDirectory(prefix="mattgs-frames-") as folder:
        extract_frames(capture.path, Path(folder), capture.frames, progress)
        frames = CaptureConfig(
            name=capture.name, path=Path(folder), kind="photos", masks=capture.masks
        )
        yield open_source(frames)


def _coverage(source: Source, where: SourcePhoto, photo: Photo) -> Mask | None:
    """Decode a photo's mask [H, W] as it was saved, still distorted; None where it has none."""
    posed = source.posed.get(where.path)
    if source.own_masks is not None:
        return decode_coverage(find_mask(source.own_masks, where.relative), photo.size)
    if photo.alpha is not None:
        binary(photo.alpha, f"{where.path}: alpha")
        return photo.alpha
    if posed is not None and posed.mask is not None:
        return decode_coverage(posed.mask, photo.size)
    if source.masks is not None:
        return decode_coverage(find_mask(source.masks, where.relative), photo.size)
    return None


def _points(source: Source, path: Path) -> GivenPoints:
    """Read the points that came with a capture; photos go by their views' names from here on."""
    points = read_points(path)
    kept = {photo.name for photo in source.photos}
    names = tuple(view_name(name) for name in points.photos)
    used = np.array([name in kept for name in names], dtype=bool)
    seen = points.seen[used[points.seen[:, 0]]] if len(points.seen) else points.seen
    return GivenPoints(points.xyz, points.rgb, names, seen)


@dataclass(frozen=True)
class _Checked:
    """What one photo showed when it was decoded; ``inverted`` is None where it has no mask.

    ``missing`` says that the folder of masks has none for it.
    """

    problems: Sequence[str]
    readable: bool = False
    alpha: bool = False
    inverted: bool | None = None
    missing: bool = False


def _check(source: Source, threads: int, progress: Progress) -> MasksAre:
    """Decode everything once and say whose masks there are; raises with all problems."""
    total = len(source.photos)
    if total < MINIMUM_PHOTOS:
        raise InputError(
            f"{source.root}: found {total} photos; at least {MINIMUM_PHOTOS} are needed to find "
            "the cameras, and 30 or more from all sides for a good model: add photos"
        )
    found: dict[str, _Checked] = {}
    look = each_view(partial(_look, source), source.photos, threads=threads)
    for index, (where, one) in enumerate(zip(source.photos, look, strict=True)):
        found[where.name] = one
        progress(index + 1, 2 * total, f"{where.name} checked")
    problems = [problem for one in found.values() for problem in one.problems]
    missing = [photo.relative for photo in source.photos if found[photo.name].missing]
    folder = source.own_masks or source.masks
    if missing and folder is not None:
        problems.append(missing_masks(folder, missing))
    inverted = {name: one.inverted for name, one in found.items() if one.inverted is not None}
    upside_down = polarity_problem(inverted)
    unmasked = sorted(name for name, one in found.items() if one.readable and name not in inverted)
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
    alpha = any(one.alpha for one in found.values())
    return "alpha" if alpha and source.own_masks is None else "given"


def _look(source: Source, where: SourcePhoto) -> _Checked:
    """Decode one photo and its mask, and say what is wrong with them."""
    readable = alpha = False
    problems: list[str] = []
    try:
        photo = _decoded(source, where)
        readable, alpha = True, photo.alpha is not None
        problems += camera_problems(where.path, photo.size, source.posed.get(where.path))
        coverage = _coverage(source, where, photo)
        if coverage is None:
            return _Checked(problems, readable, alpha)
        mask = binary(coverage, str(where.path))
    except NoMaskError:
        return _Checked(problems, readable, alpha, missing=True)
    except InputError as error:
        return _Checked([*problems, str(error)], readable, alpha)
    if mask.all():
        problems.append(f"{where.path}: its mask is white all over; expected object and background")
    return _Checked(problems, readable, alpha, looks_inverted(mask))


def _decoded(source: Source, where: SourcePhoto) -> Photo:
    """Decode a photo the way up that its camera means."""
    photo = decode(where.path)
    if is_as_stored(where.path, photo.size, source.posed.get(where.path)):
        return decode(where.path, as_stored=True)
    return photo


def _write_view(
    where: SourcePhoto,
    split: Split,
    *,
    source: Source,
    max_size: int,
    out: Path,
    lenses: Undistortions,
) -> View:
    """Write one photo and its mask."""
    photo = _decoded(source, where)
    rgb, coverage = on_white(photo), _coverage(source, where, photo)
    mask = None if coverage is None else binary(coverage, str(where.path))
    camera, posed = None, source.posed.get(where.path)
    if posed is not None:
        intrinsics = posed.lens.intrinsics
        if not posed.lens.is_pinhole:
            lens = lenses.of(posed.lens)
            intrinsics = lens.intrinsics
            rgb = lens.photo(rgb)
            mask = None if mask is None else lens.mask(mask)
            coverage = None if coverage is None else lens.coverage(coverage)
        camera = Camera(intrinsics, posed.rotation, posed.translation)
    size = _reduced(photo.size, max_size)
    if size != photo.size:
        camera = None if camera is None else camera.scaled(*size)
        rgb = _area(rgb, size)
        mask = None if mask is None else binary(_area(mask, size), f"{where.path}: reduced mask")
        coverage = None if coverage is None else _area(coverage, size)
    file = f"{where.name}.png"
    write_png(out / "photos" / file, rgb)
    for folder, values in (("masks", mask), ("coverage", coverage)):
        if values is not None:
            write_png(out / folder / file, values)
    return View(
        where.name,
        split,
        *size,
        photo=out / "photos" / file,
        mask=None if mask is None else out / "masks" / file,
        camera=camera,
        ids=_write_ids(source, file, size, out),
        focal=None if photo.focal is None else photo.focal * size[0] / photo.size[0],
        lens=photo.lens,
        coverage=None if coverage is None else out / "coverage" / file,
        cut_out=source.own_masks is None and photo.alpha is not None,
        taken=None if size == photo.size else photo.size,
    )


def _write_ids(source: Source, file: str, size: tuple[int, int], out: Path) -> Path | None:
    """Copy what the renderer knows of a view's small structures, where it does."""
    if source.ids is None or not (source.ids / file).is_file():
        return None
    path = out / "ids" / file
    path.parent.mkdir(exist_ok=True)
    with Image.open(source.ids / file) as ids:
        ids.resize(size, Image.Resampling.NEAREST).save(path)
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
