"""Trained splats → stored renders → scores; and how fast they render.

:func:`render_views` writes 8-bit PNGs of every registered view beside what it should look like::

    renders/{test,train}/NAME.png   truth/{test,train}/NAME.png   masks/{test,train}/NAME.png
    [details/test/NAME.png]   [haze/test/NAME.png]   views.json

Truth, masks and details come from :mod:`truth`, by link where they are stored already.

:func:`score` reads those files and nothing else, and writes ``evaluation.json``: so what was
scored can be looked at, and scored again. Test views that structure-from-motion could not place
are listed as missing, never left out in silence. :mod:`speed` measures speed apart.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.capture.photos import write_png
from mattgs_ops.capture.scene import Scene, Split
from mattgs_ops.config import Condition
from mattgs_ops.errors import InputError
from mattgs_ops.frozen import Background
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.score.haze import haze_map
from mattgs_ops.score.lpips import Lpips
from mattgs_ops.score.metric_table import IMAGE_METRICS, METRICS
from mattgs_ops.score.metrics import SSIM_REACH, score_view
from mattgs_ops.score.truth import (
    StoredTruth,
    TruthView,
    as_bytes,
    link_truth,
    store_truth,
    write_json,
)
from mattgs_ops.splat.attention import paper_attention
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.photos import WHITE, Colour, camera_at
from mattgs_ops.splat.render import render_view
from mattgs_ops.store.digests import file_digest, folder_digest, pixels_digest

SCHEMA = 1
BYTES_PER_MB = 1e6  # size_mb is in megabytes, not mebibytes
VIEWS_FILE = "views.json"
EVALUATION_FILE = "evaluation.json"
MASK_THRESHOLD = 128  # of 255: a pixel is object when at least half of it is
SPLITS: tuple[Split, ...] = get_args(Split)


@dataclass(frozen=True)
class RenderedView(TruthView):
    """One view on disk; ``hazed``: what hangs in the air before the camera is known."""

    hazed: bool = False


@dataclass(frozen=True)
class RenderedViews:
    """The content of ``views.json``: what was rendered, from what.

    Of the training views the first and every ``train_every``-th after it were rendered; ``missing``
    are test views without a camera. ``size_bytes`` is the PLY's size, ``splats_sha256`` its digest.
    """

    schema: int
    condition: str
    resolution: int
    background: Colour
    train_every: int
    views: tuple[RenderedView, ...]
    missing: tuple[str, ...]
    splats: int
    size_bytes: int
    splats_sha256: str

    def save(self, folder: Path) -> None:
        """Write ``folder/views.json``."""
        write_json(folder / VIEWS_FILE, asdict(self))

    @classmethod
    def load(cls, folder: Path) -> "RenderedViews":
        """Read ``folder/views.json``; raises :class:`InputError` when it is not there or broken."""
        path = folder / VIEWS_FILE
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            views = tuple(RenderedView(**row) for row in data.pop("views"))
            background, missing = tuple(data.pop("background")), tuple(data.pop("missing"))
            return cls(**data, views=views, background=background, missing=missing)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: expected the list of rendered views: {error}") from error


def render_views(
    scene: Scene,
    splats_ply: Path,
    condition: Condition,
    resolution: int,
    out: Path,
    *,
    background: Colour = WHITE,
    truth: Path | None = None,
    train_every: int = 1,
    threads: int = 1,
    progress: Progress = no_progress,
) -> RenderedViews:
    """Render all registered test views, and every ``train_every``-th training view, into ``out``.

    ``resolution`` is the longest side in pixels. ``background`` is the colour that ``original``
    was trained over; ``nobg`` is always shown over white, as its truth is. ``truth`` is a folder of
    :func:`store_truth`, made with the same settings; without one it is stored in ``out``. Raises
    :class:`StageError` when no test view has a camera, :class:`InputError` for another truth.
    """
    shown: Colour = WHITE if condition.background == "nobg" else background
    stored = _stored_truth(scene, condition.background, resolution, train_every, truth, out)
    splats, points = read_ply(splats_ply), scene.points().xyz
    by_name = {view.name: view for view in scene.views}
    rendered = []
    for index, view in enumerate(stored.views):
        camera = camera_at(by_name[view.name], resolution)
        place = Path(view.split) / f"{view.name}.png"
        write_png(out / "renders" / place, render_view(splats, camera, shown, threads=threads))
        haze = None
        if view.split == "test":
            haze = haze_map(splats, camera, points, threads=threads)
        if haze is not None:
            write_png(out / "haze" / place, as_bytes(haze))
        rendered.append(RenderedView(**asdict(view), hazed=haze is not None))
        progress(index + 1, len(stored.views), f"{view.name} rendered")
    result = RenderedViews(
        schema=SCHEMA,
        condition=str(condition),
        resolution=resolution,
        background=shown,
        train_every=train_every,
        views=tuple(rendered),
        missing=stored.missing,
        splats=len(splats),
        size_bytes=splats_ply.stat().st_size,
        splats_sha256=file_digest(splats_ply),
    )
    result.save(out)
    return result


def _stored_truth(
    scene: Scene,
    background: Background,
    resolution: int,
    train_every: int,
    folder: Path | None,
    out: Path,
) -> StoredTruth:
    """Return what the renders are compared with, once it lies in ``out``."""
    if folder is None:
        return store_truth(scene, background, resolution, out, train_every=train_every)
    stored = link_truth(folder, out)
    wanted, found = (
        (background, resolution, train_every),
        (stored.background, stored.resolution, stored.train_every),
    )
    if found != wanted:
        raise InputError(
            f"{folder}: expected truth of background, resolution and share of training views "
            f"{wanted}, found {found}"
        )
    return stored


def score(
    folder: Path,
    *,
    ssim_lambda: float = 0.2,
    lpips: Path | None = None,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Score the renders stored in ``folder`` and write its ``evaluation.json``.

    The result holds ``metrics`` (means over views by id, training views as ``train_…``; absent
    where no view has the metric), ``per_view`` (a list of objects with ``view``, ``split`` and the
    image metrics), ``missing`` (test views that could not be rendered), ``counts`` of what went
    into each mean, and digests of what was scored, truth and masks by their pixels on held-out
    views. ``ssim_lambda`` is λ of the loss, ``lpips`` a file of LPIPS's weights. Raises
    :class:`InputError` for files that are missing or do not fit each other.
    """
    rendered = RenderedViews.load(folder)
    network = None if lpips is None else Lpips.load(lpips)
    per_view: list[dict[str, Any]] = []
    for index, view in enumerate(rendered.views):
        per_view.append(_score_one(folder, view, ssim_lambda, network))
        progress(index + 1, len(rendered.views), f"{view.name} scored")
    metrics: dict[str, float] = {}
    counts: dict[str, int] = {}
    for split in SPLITS:
        prefix = "" if split == "test" else f"{split}_"
        rows = [row for row in per_view if row["split"] == split]
        for name in IMAGE_METRICS:
            values = [row[name] for row in rows if row.get(name) is not None]
            if values:
                metrics[prefix + name] = float(np.mean(values))
                counts[prefix + name] = len(values)
    metrics |= {
        "size_mb": rendered.size_bytes / BYTES_PER_MB,
        "splats": rendered.splats,
        "test_views": sum(view.split == "test" for view in rendered.views),
        "missing_views": len(rendered.missing),
    }
    evaluation = {
        "schema": SCHEMA,
        "condition": rendered.condition,
        "resolution": rendered.resolution,
        "ssim_lambda": ssim_lambda,
        "mask_erosion": SSIM_REACH,
        "masks": masks_that_scored(rendered),
        "train_every": rendered.train_every,
        "metrics": metrics,
        "versions": {name: METRICS[name].version for name in metrics},
        "counts": counts,
        "per_view": per_view,
        "missing": list(rendered.missing),
        "digests": {
            "renders": folder_digest(folder / "renders"),
            "splats": rendered.splats_sha256,
            **_scored_digests(folder, rendered),
        },
    }
    write_json(folder / EVALUATION_FILE, evaluation)
    return evaluation


def masks_that_scored(rendered: RenderedViews) -> Literal["exact", "pipeline", "both", "none"]:
    """Say whose masks the held-out views are scored by."""
    found = {view.exact for view in rendered.views if view.split == "test" and view.masked}
    if not found:
        return "none"
    return "both" if len(found) > 1 else "exact" if True in found else "pipeline"


def _scored_digests(folder: Path, rendered: RenderedViews) -> dict[str, str]:
    """Return digests of the pixels that the scores of held-out views hang on: truth and masks."""
    shown = [view for view in rendered.views if view.split == "test"]
    return {
        "truth": pixels_digest((v.name, _read(folder, "truth", v, "RGB")) for v in shown),
        "masks": pixels_digest((v.name, _read(folder, "masks", v, "L")) for v in shown if v.masked),
    }


def _score_one(
    folder: Path, view: RenderedView, ssim_lambda: float, lpips: Lpips | None
) -> dict[str, Any]:
    image = _read(folder, "renders", view, "RGB")
    truth = _read(folder, "truth", view, "RGB")
    if image.shape != truth.shape:
        raise InputError(
            f"{folder}: the render of {view.name} is {image.shape[1]} x {image.shape[0]}, its "
            f"truth {truth.shape[1]} x {truth.shape[0]}; render the views again"
        )
    mask = _read(folder, "masks", view, "L") >= MASK_THRESHOLD if view.masked else None
    details = _read(folder, "details", view, "L") > 0 if view.detailed else None
    haze = _read(folder, "haze", view, "L") / np.float32(255) if view.hazed else None
    scores = score_view(
        image / 255,
        truth / 255,
        mask,
        attention=paper_attention(truth.astype(np.float32) / np.float32(255)),
        ssim_lambda=ssim_lambda,
        details=details,
        haze=haze,
        lpips=lpips,
    )
    return {"view": view.name, "split": view.split, **scores}


def _read(
    folder: Path, kind: str, view: RenderedView, mode: Literal["RGB", "L"]
) -> NDArray[np.uint8]:
    path = folder / kind / view.split / f"{view.name}.png"
    try:
        with Image.open(path) as image:
            if image.mode != mode:
                raise InputError(f"{path}: expected an 8-bit {mode} image, found {image.mode}")
            pixels: NDArray[np.uint8] = np.asarray(image, dtype=np.uint8)
            return pixels
    except OSError as error:
        raise InputError(f"{path}: expected a stored render: {error}") from error
