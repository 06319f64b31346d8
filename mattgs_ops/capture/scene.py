"""The two folders that stages hand on: a prepared capture, and a scene ready for training.

A **prepared capture** (written by ``prepare.py``) holds upright 8-bit RGB photos, the split, and
what came with them::

    capture.json   photos/NAME.png   [masks/NAME.png   coverage/NAME.png]   [ids/NAME.png]
    [given_points.npz]

A **scene** (written by ``mattgs_ops/sfm``) holds photos and masks without lens distortion, the
pinhole cameras that were found, and the sparse points::

    scene.json   photos/NAME.png   masks/NAME.png   [coverage/NAME.png]   [ids/NAME.png]
    points.npz   sparse/0/*.bin

Names are the photo's original file names (``IMG_1.jpg``; ``left__IMG_1.jpg`` for a photo that lies
in a folder ``left`` of its own), files on disk carry ``NAME.png`` after
COLMAP's habit (``IMG_1.jpg.png``). Masks are 8-bit, 255 = object; in a scene they are the
pipeline's own, which methods train with. Coverage is the mask that came with the capture, where
one did: of 255, the share of each pixel that is object, not thresholded; it scores. Ids, which a
renderer knows of its test views, are 8-bit: 1 screws, 2 wires, 3 print, 0 the rest.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.errors import InputError
from mattgs_ops.naming import below, is_below

Split = Literal["train", "test"]
SCHEMA = 1
POINTS_FILE = "given_points.npz"
# A view's fields that JSON holds as they are
PLAIN_FIELDS = ("name", "split", "width", "height", "focal", "lens", "cut_out", "taken")
FROM_OBJECT = "poses from inside masks alone"  # ends the step of ``fallbacks`` that says so


@dataclass(frozen=True)
class View:
    """One photo. Paths are absolute; ``camera`` is None when unknown.

    ``focal`` is the focal length in pixels that the photo's EXIF tells, None where it tells none;
    ``lens`` is what it says of the camera, empty where it says nothing. ``taken``: width and height
    before the photo was reduced, None where it was not.
    ``coverage`` is the exact mask, None where none came with the capture. ``cut_out``: the photo
    shows the object on white already, as one with an alpha channel does.
    """

    name: str
    split: Split
    width: int
    height: int
    photo: Path
    mask: Path | None
    camera: Camera | None
    ids: Path | None = None
    focal: float | None = None
    lens: str = ""
    coverage: Path | None = None
    cut_out: bool = False
    taken: tuple[int, int] | None = None

    @property
    def as_taken(self) -> tuple[int, int]:
        """Width and height before the photo was reduced."""
        return self.taken or (self.width, self.height)


@dataclass(frozen=True)
class GivenPoints:
    """Points that came with a capture: ``xyz`` [P, 3] float64, ``rgb`` [P, 3] uint8.

    ``seen`` [O, 2] int64 says which photo sees which point, as rows of ``photos`` and of ``xyz``;
    it is empty where that is not known.
    """

    xyz: NDArray[np.float64]
    rgb: NDArray[np.uint8]
    photos: tuple[str, ...]
    seen: NDArray[np.int64]

    def save(self, path: Path) -> None:
        """Write an NPZ file."""
        photos = np.array(self.photos, dtype=np.str_)
        np.savez_compressed(path, xyz=self.xyz, rgb=self.rgb, photos=photos, seen=self.seen)

    @classmethod
    def load(cls, path: Path) -> "GivenPoints":
        """Read an NPZ file that was written by :meth:`save`."""
        data = _read_arrays(path, ("xyz", "rgb", "photos", "seen"))
        photos = tuple(str(name) for name in data["photos"])
        return cls(data["xyz"], data["rgb"], photos, data["seen"])


@dataclass(frozen=True)
class PreparedCapture:
    """Photos as every later stage sees them; views sorted by name.

    ``masks_are`` says whose masks they are: ``alpha`` or ``given`` come from the user and may be
    used as they are, ``truth`` is a renderer's exact mask and serves to score other masks only,
    ``none`` means that there are none. ``cameras_are`` likewise: ``given``, ``truth`` or ``none``.
    ``split_is`` says who chose the test views: ``given`` with the capture, or ``every`` so-many-th
    photo by name. ``left_out`` names photos that the capture's own split puts into neither part.
    """

    name: str
    folder: Path
    views: tuple[View, ...]
    masks_are: Literal["alpha", "given", "truth", "none"]
    cameras_are: Literal["given", "truth", "none"]
    split_is: Literal["given", "every"] = "every"
    left_out: tuple[str, ...] = ()

    @property
    def points(self) -> GivenPoints | None:
        """The points that came with the capture, None where none did."""
        path = self.folder / POINTS_FILE
        return GivenPoints.load(path) if path.is_file() else None

    def save(self) -> None:
        """Write ``capture.json`` into ``folder``."""
        extra = {
            "masks_are": self.masks_are,
            "cameras_are": self.cameras_are,
            "split_is": self.split_is,
            "left_out": list(self.left_out),
        }
        _write(self.folder / "capture.json", self.name, self.views, extra)

    @classmethod
    def load(cls, folder: Path) -> "PreparedCapture":
        """Read a prepared capture; raises :class:`InputError` naming what is wrong."""
        data, views = _read(folder, "capture.json")
        return cls(
            data["name"],
            folder,
            views,
            data["masks_are"],
            data["cameras_are"],
            data["split_is"],
            tuple(data["left_out"]),
        )


@dataclass(frozen=True)
class SparsePoints:
    """Triangulated points.

    ``xyz`` [P, 3] float64, ``rgb`` [P, 3] uint8, ``object_share`` [P] float32: of the views that
    see a point, the share in whose mask it lies; ``views_seen`` [P] int32.
    """

    xyz: NDArray[np.float64]
    rgb: NDArray[np.uint8]
    object_share: NDArray[np.float32]
    views_seen: NDArray[np.int32]

    def chosen(self, rows: NDArray[np.bool_] | slice) -> "SparsePoints":
        """Return some of the points."""
        return SparsePoints(
            self.xyz[rows], self.rgb[rows], self.object_share[rows], self.views_seen[rows]
        )


@dataclass(frozen=True)
class Scene:
    """A capture with cameras; views sorted by name, unregistered ones have no camera."""

    name: str
    folder: Path
    views: tuple[View, ...]
    extra: Mapping[str, Any]  # what SfM reports: mode, counts, fallbacks, seconds

    def save(self, points: SparsePoints) -> None:
        """Write ``scene.json`` and ``points.npz`` into ``folder``."""
        _write(self.folder / "scene.json", self.name, self.views, {"extra": dict(self.extra)})
        np.savez(self.folder / "points.npz", **vars(points))

    @classmethod
    def load(cls, folder: Path) -> "Scene":
        """Read a scene; raises :class:`InputError` naming what is wrong."""
        data, views = _read(folder, "scene.json")
        return cls(data["name"], folder, views, data["extra"])

    def points(self) -> SparsePoints:
        """Read the sparse points; raises :class:`InputError` when the file holds anything else."""
        names = tuple(field.name for field in fields(SparsePoints))
        return SparsePoints(**_read_arrays(self.folder / "points.npz", names))

    def registered(self, split: Split) -> tuple[View, ...]:
        """Return the views of a split that have a camera and were not dropped.

        A held-out view whose exact mask is known is scored by that, whatever the pipeline found.
        """
        lost = set(self.dropped)
        if split == "test":
            lost -= {view.name for view in self.views if view.coverage is not None}
        found = (v for v in self.views if v.split == split and v.camera is not None)
        return tuple(view for view in found if view.name not in lost)

    @property
    def dropped(self) -> tuple[str, ...]:
        """Names of views in which no object was found: none is trained on."""
        return tuple(self.extra.get("dropped", ()))

    def example_view(self) -> View | None:
        """Return the view to show where one stands for all: a held-out one with a camera if any."""
        views = self.registered("test") or self.registered("train")
        return views[len(views) // 2] if views else None


def _read_arrays(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read the arrays of an NPZ file; raises :class:`InputError` when it has not all of them."""
    expected = f"{path}: expected arrays {', '.join(names)}"
    try:
        with np.load(path, allow_pickle=False) as data:  # a pickle may run whatever it likes
            return {name: data[name] for name in names}
    except KeyError as error:
        raise InputError(f"{expected}, found no {error}") from error
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise InputError(f"{expected}: {error}") from error


def _write(path: Path, name: str, views: tuple[View, ...], extra: Mapping[str, Any]) -> None:
    rows = [_view_to_json(view, path.parent) for view in views]
    document = {"schema": SCHEMA, "name": name, **extra, "views": rows}
    path.write_text(json.dumps(document, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _read(folder: Path, file: str) -> tuple[dict[str, Any], tuple[View, ...]]:
    path = folder / file
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # no file, no UTF-8 or no JSON
        raise InputError(f"{path}: expected a readable JSON file: {error}") from error
    if not isinstance(data, dict) or not isinstance(data.get("views", []), list):
        raise InputError(f"{path}: expected a JSON object with a list `views`")
    if data.get("schema") != SCHEMA:
        raise InputError(f"{path}: expected schema {SCHEMA}, found {data.get('schema')!r}")
    return data, tuple(_view_from_json(row, folder, path) for row in data["views"])


def _view_to_json(view: View, folder: Path) -> dict[str, Any]:
    row = {field: getattr(view, field) for field in PLAIN_FIELDS}
    for field in ("photo", "mask", "ids", "coverage"):
        path = getattr(view, field)
        row[field] = None if path is None else str(path.relative_to(folder))
    camera = view.camera
    row["camera"] = (
        None
        if camera is None
        else {
            "intrinsics": vars(camera.intrinsics),
            "rotation": camera.rotation.tolist(),
            "translation": camera.translation.tolist(),
        }
    )
    return row


def _view_from_json(row: dict[str, Any], folder: Path, source: Path) -> View:
    """Read a view; its name names files that later stages write, its paths files that they read."""
    name, camera = str(row["name"]), row["camera"]
    if "/" in name or not is_below(name):
        raise InputError(f"{source}: `name`: expected the name of a file, found {name!r}")

    def place(field: str) -> Path:
        return below(folder, row[field], f"{source}: `{field}` of {name}")

    return View(
        name=name,
        split=row["split"],
        width=row["width"],
        height=row["height"],
        photo=place("photo"),
        mask=None if row["mask"] is None else place("mask"),
        ids=place("ids") if row.get("ids") else None,
        focal=row.get("focal"),
        lens=str(row.get("lens", "")),
        coverage=place("coverage") if row.get("coverage") else None,
        cut_out=bool(row.get("cut_out", False)),
        taken=tuple(row["taken"]) if row.get("taken") else None,
        camera=None
        if camera is None
        else Camera(
            Intrinsics(**camera["intrinsics"]),
            np.array(camera["rotation"], dtype=np.float64),
            np.array(camera["translation"], dtype=np.float64),
        ),
    )
