"""What renders are compared with: stored once for all experiments of a capture and background.

:func:`store_truth` writes 8-bit PNGs of every registered view that is scored::

    truth/{test,train}/NAME.png   masks/{test,train}/NAME.png   [details/test/NAME.png]   truth.json

:func:`link_truth` puts them into an experiment's folder without a copy, where that is possible.
"""

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.capture.photos import write_png
from mattgs_ops.capture.scene import Scene, Split
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.frozen import Background
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.splat.photos import load_truth
from mattgs_ops.whole_file import write_text_whole

SCHEMA = 1
TRUTH_FILE = "truth.json"
KINDS = ("truth", "masks", "details")
# of a pixel: a wire rarely fills half of one, see docs/captures.md on id maps
DETAIL_SHARE = 0.25


@dataclass(frozen=True)
class TruthView:
    """One view on disk; ``masked``: it has a mask; ``detailed``: its small structures are known.

    ``exact``: the mask is the one that came with the capture, not the pipeline's.
    """

    name: str
    split: Split
    masked: bool
    detailed: bool = False
    exact: bool = False


@dataclass(frozen=True)
class StoredTruth:
    """The content of ``truth.json``.

    Of the training views the first and every ``train_every``-th after it are there; ``missing`` are
    test views without a camera. ``resolution`` is the longest side in pixels.
    """

    schema: int
    background: Background
    resolution: int
    train_every: int
    views: tuple[TruthView, ...]
    missing: tuple[str, ...]

    @classmethod
    def load(cls, folder: Path) -> "StoredTruth":
        """Read ``folder/truth.json``; raises :class:`InputError` when it is not there or broken."""
        path = folder / TRUTH_FILE
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            views = tuple(TruthView(**row) for row in data.pop("views"))
            return cls(**data | {"missing": tuple(data["missing"])}, views=views)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: expected the list of stored views: {error}") from error


def store_truth(
    scene: Scene,
    background: Background,
    resolution: int,
    out: Path,
    *,
    train_every: int = 1,
    progress: Progress = no_progress,
) -> StoredTruth:
    """Store all registered test views, and every ``train_every``-th training view, in ``out``.

    Raises :class:`StageError` when no test view has a camera.
    """
    chosen = [*scene.registered("test"), *scene.registered("train")[::train_every]]
    usable = {view.name for view in scene.registered("test")}
    missing = tuple(v.name for v in scene.views if v.split == "test" and v.name not in usable)
    if not usable:
        raise StageError(
            f"scene {scene.name}: expected test views with a camera, found none of {len(missing)}"
        )
    stored = []
    for index, view in enumerate(chosen):
        target = load_truth(view, background, resolution)
        masked = view.mask is not None or view.coverage is not None
        place = Path(view.split) / f"{view.name}.png"
        write_png(out / "truth" / place, as_bytes(target.image))
        if masked:
            write_png(out / "masks" / place, as_bytes(target.mask))
        # what training views show of small structures is not scored, even where it is known
        ids = view.ids if view.split == "test" else None
        if ids is not None:
            write_png(out / "details" / place, small_structures(ids, target.mask.shape))
        has = masked, ids is not None, view.coverage is not None
        stored.append(TruthView(view.name, view.split, *has))
        progress(index + 1, len(chosen), f"{view.name} stored")
    result = StoredTruth(SCHEMA, background, resolution, train_every, tuple(stored), missing)
    write_json(out / TRUTH_FILE, asdict(result))
    return result


def link_truth(folder: Path, out: Path) -> StoredTruth:
    """Put what lies in ``folder`` into ``out``: hard links, or copies between file systems.

    Raises :class:`InputError` where ``folder`` holds no stored truth.
    """
    stored = StoredTruth.load(folder)
    for kind in KINDS:
        for source in sorted((folder / kind).rglob("*.png")):
            target = out / source.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.unlink(missing_ok=True)
            try:
                os.link(source, target)
            except OSError:  # another file system, or one without links
                shutil.copyfile(source, target)
    return stored


def write_json(path: Path, document: Mapping[str, Any] | Sequence[Any]) -> None:
    """Write a document whole or not at all; raises :class:`ValueError` for NaN and infinity."""
    text = json.dumps(document, indent=1, sort_keys=True, allow_nan=False)
    write_text_whole(path, text + "\n")


def as_bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return values in [0, 1] as 0 to 255."""
    pixels: NDArray[np.uint8] = np.rint(values * np.float32(255)).astype(np.uint8)
    return pixels


def small_structures(ids: Path, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return where small structures are, 255, in an image of ``shape`` [H, W]."""
    with Image.open(ids) as stored:
        small = (np.asarray(stored.convert("L")) > 0).astype(np.float32)
    share = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.where(share >= DETAIL_SHARE, 255, 0).astype(np.uint8)
