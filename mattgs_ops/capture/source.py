"""Which photos, cameras, masks and points a capture consists of; nothing is decoded yet.

Six kinds are read. **Bundled**: the package's own, with a renderer's exact masks and cameras.
**photos**: a folder of photos, folders within it included, or one that holds ``images/``.
**nerfstudio**: a ``transforms.json``, or NeRF's ``transforms_train.json`` and its fellows.
**colmap**: ``images/`` and ``sparse/0``. **video**: a file, see ``video.py``.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal

from mattgs_ops.capture.formats import colmap, nerfstudio
from mattgs_ops.capture.formats.colmap_model import model_files
from mattgs_ops.capture.formats.posed import PosedCapture, PosedPhoto, raise_all
from mattgs_ops.capture.formats.split_lists import listed_names, read_lists
from mattgs_ops.capture.mask_files import NOTE
from mattgs_ops.capture.photos import (
    FOLDER_MARK,
    OUTPUT_MARK,
    SIDECARS,
    SYSTEM_FILES,
    list_photos,
)
from mattgs_ops.capture.scene import Split
from mattgs_ops.capture.video import VIDEO_SUFFIXES
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError
from mattgs_ops.naming import numbers_by_value

RENDERED_FILE = "object.json"  # how a rendered capture was made (synthetic/render.py)
BUNDLED_FOLDER = Path(__file__).resolve().parent.parent / "bundled"
IMAGES, MASKS = "images", "masks"  # folders of a capture, as nerfstudio and COLMAP call them


@dataclass(frozen=True)
class SourcePhoto:
    """A photo's file; ``relative`` is its name below the folder of all photos, with slashes."""

    path: Path
    relative: str

    @property
    def name(self) -> str:
        """What the view is called from here on."""
        return view_name(self.relative)


@dataclass(frozen=True)
class Source:
    """What was found: photos sorted by view name, their poses, masks and split where known.

    ``split`` is empty where the capture does not say which photos are held out. Numbers
    in names are sorted by their value. ``points`` is a
    point cloud's file or a COLMAP model's folder. ``masks`` lie beside the photos, ``own_masks`` is
    the folder that the user named, ``ids`` holds small structures of some views, from a renderer.
    """

    root: Path
    photos: tuple[SourcePhoto, ...]
    cameras_are: Literal["given", "truth", "none"]
    posed: Mapping[Path, PosedPhoto] = field(default_factory=dict)
    split: Mapping[Path, Split] = field(default_factory=dict)
    left_out: tuple[Path, ...] = ()
    points: Path | None = None
    own_masks: Path | None = None
    masks: Path | None = None
    ids: Path | None = None
    read: tuple[Path, ...] = ()

    def files(self) -> Iterator[Path]:
        """Yield every file below ``root`` that shapes the prepared capture, id maps excepted."""
        yield from (photo.path for photo in self.photos)
        yield from self.read
        yield from (posed.mask for posed in self.posed.values() if posed.mask is not None)
        if self.masks is not None:
            yield from files_below(self.masks)
        if self.points is not None:
            yield from model_files(self.points) if self.points.is_dir() else (self.points,)


def files_below(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder but those that systems and tools leave there."""
    for path in folder.rglob("*"):
        lower = path.name.lower()
        own = lower.startswith(".") or lower in SYSTEM_FILES or lower.endswith(SIDECARS)
        if path.is_file() and not own:
            yield path


def view_name(relative: str) -> str:
    """Return what the view of a photo is called: folders are kept as part of its name."""
    return relative.replace("/", FOLDER_MARK)


def is_video(capture: CaptureConfig) -> bool:
    """Say whether a capture is a video's file."""
    path = capture.path
    if path is None or capture.kind not in ("auto", "video"):
        return False
    return capture.kind == "video" or (path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES)


def open_source(capture: CaptureConfig) -> Source:
    """Find photos, poses, masks, split and points of any capture but a video's.

    Raises :class:`InputError` on what is missing.
    """
    if capture.masks is not None and not capture.masks.is_dir():
        raise InputError(f"{capture.masks}: expected a folder of masks, found none")
    if capture.path is None:
        root = BUNDLED_FOLDER / capture.name
        if not nerfstudio.is_there(root):
            raise InputError(f"{root}: the bundled capture is missing; reinstall the package")
        found = nerfstudio.read_nerfstudio(root)
        places = {"masks": root / "masks", "ids": root / "ids", "own_masks": capture.masks}
        return _of_frames(root, found, "truth", **places)
    root = capture.path
    if not root.is_dir():
        kind = "a file" if root.is_file() else "nothing"
        raise InputError(f"{root}: expected a folder of photos, found {kind}{_advice(root)}")
    kind = _detect(root) if capture.kind == "auto" else capture.kind
    if kind == "nerfstudio":
        found = nerfstudio.read_nerfstudio(root)
        # `mattgs captures render` writes both; a folder `ids` of any other origin is something else
        ids = root / "ids" if (root / RENDERED_FILE).is_file() else None
        places = {"masks": _mask_folder(root), "ids": ids, "own_masks": capture.masks}
        return _of_frames(root, found, "given", **places)
    return _of_folder(capture, root, with_model=kind == "colmap")


def _advice(file: Path) -> str:
    """Say what to do with a file that may hold cameras but is not called as they are."""
    if file.suffix.lower() != ".json":
        return ""
    return "; if it lists cameras, rename it to transforms.json, and name the folder that it is in"


def _detect(root: Path) -> Literal["photos", "nerfstudio", "colmap"]:
    if nerfstudio.is_there(root):
        return "nerfstudio"
    return "photos" if colmap.model_folder(root) is None else "colmap"


def _of_frames(
    root: Path,
    found: PosedCapture,
    cameras_are: Literal["given", "truth"],
    **places: Path | None,
) -> Source:
    """Make a source of frames that a file lists; names begin below the folder they share.

    Where that file has no split, lists of names beside it count.
    """
    paths = [posed.photo for posed in found.photos]
    shared = Path(os.path.commonpath([path.parent for path in paths])) if paths else root
    split, left_out, lists = found.split, found.left_out, read_lists([root])
    if lists.any and not split:
        split, left_out = lists.assign(
            {name: path for path in paths for name in listed_names(path, [shared, root])}
        )
    return Source(
        root,
        _named([path for path in paths if path not in left_out], shared),
        cameras_are,
        posed={posed.photo: posed for posed in found.photos if posed.photo not in left_out},
        split=split,
        left_out=left_out,
        points=found.points,
        read=(*found.read, *lists.files),
        **places,
    )


def _of_folder(capture: CaptureConfig, root: Path, *, with_model: bool) -> Source:
    """Make a source of a folder of photos, with the COLMAP model beside them or without."""
    images = root / IMAGES if (root / IMAGES).is_dir() else root
    paths, problems = list_photos(images, capture.masks)
    if images != root:
        problems += _beside(root, images)
    if capture.masks is None:
        problems += _unused_masks(images)
    problems += _masks_among(paths, images)
    raise_all(problems)
    found, model = PosedCapture(()), colmap.model_folder(root) or root / "sparse"
    if with_model:
        found = colmap.read_colmap(model, images)
    lists = read_lists([root, model] if with_model else [root])
    split, left_out = dict[Path, Split](), tuple[Path, ...]()
    if lists.any:
        named = {name: path for path in paths for name in listed_names(path, [images, root])}
        split, left_out = lists.assign(named)
    return Source(
        images,
        _named([path for path in paths if path not in left_out], images),
        "given" if with_model else "none",
        posed={posed.photo: posed for posed in found.photos if posed.photo not in left_out},
        split=split,
        left_out=left_out,
        points=found.points,
        own_masks=capture.masks,
        masks=_mask_folder(root, images),
        read=(*found.read, *lists.files),
    )


def _named(paths: Sequence[Path], folder: Path) -> tuple[SourcePhoto, ...]:
    """Name photos by where they lie below ``folder``; raises if two views had one name."""
    photos = [SourcePhoto(path, path.relative_to(folder).as_posix()) for path in paths]
    photos.sort(key=lambda photo: numbers_by_value(photo.name))
    problems = [
        f"{a.path} and {b.path}: both would be called {a.name}; rename one"
        for a, b in pairwise(photos)
        if a.name == b.name
    ]
    raise_all(problems)
    return tuple(photos)


def _mask_folder(*beside: Path) -> Path | None:
    """Return the folder ``masks``, in whatever case, beside photos or beside their ``images``."""
    places = [*beside, *(place.parent for place in beside if place.name == IMAGES)]
    found = (
        path
        for place in places
        for path in sorted(place.iterdir())
        if path.name.lower() == MASKS and path.is_dir()
    )
    return next(found, None)


def _unused_masks(images: Path) -> list[str]:
    """Name folders of masks within folders of photos: masks lie in one folder beside all photos."""
    return [
        f"{path}: masks in a folder of photos are not found; move them to {images / MASKS}, into "
        f"the folder {path.relative_to(images).parent}"
        for path in sorted(images.rglob("*"))
        if path.name.lower() == MASKS and path.is_dir() and path.parent != images
        if not any(part.startswith(".") for part in path.relative_to(images).parts)
        and not any((parent / OUTPUT_MARK).is_file() for parent in path.parents)
    ]


def _masks_among(paths: Sequence[Path], images: Path) -> list[str]:
    """Say where files are called like masks of photos beside them: they would count as photos."""
    masks_of = {str(path) + ".png": path for path in paths}
    masks_of |= {str(path.with_suffix("")) + NOTE: path for path in paths}
    found = [
        (path, photo)
        for path in paths
        if (photo := masks_of.get(str(path)) or masks_of.get(str(path.with_suffix(""))))
    ]
    if not found:
        return []
    path, photo = found[0]
    count = f"; so are {len(found) - 1} more" if len(found) > 1 else ""
    return [f"{path}: called like the mask of {photo.name}{count}; move masks to {images / MASKS}"]


def _beside(root: Path, images: Path) -> list[str]:
    loose = [path for path in list_photos(root)[0] if path.parent == root]
    if not loose:
        return []
    return [f"{loose[0]}: {len(loose)} photos lie beside {images}; move all into one folder"]
