"""Real runs of a small benchmark inside one process: what the gate is tried on.

The same functions that the stages call, without store, flow and registry around them: prepare, cut
out, find points, train, render, score, measure. Rows come out as ``tasks/row.py`` makes them, as
far as the gate reads them, and compare with rows of the whole line.
"""

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from flows.grid import cells
from mattgs_ops.capture.prepare import prepare
from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import BenchmarkConfig, CaptureConfig, Condition
from mattgs_ops.score.evaluate import render_views, score
from mattgs_ops.score.speed import measure_speed
from mattgs_ops.segment.infer import segment
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.sfm import reconstruct
from mattgs_ops.splat.files.training_report import TrainingReport
from mattgs_ops.splat.photos import size_at
from mattgs_ops.splat.training.train import train
from mattgs_ops.store import provenance
from mattgs_ops.store.digests import json_digest
from tasks.row import PROTOCOL, Row, config_digest, masks_digest, split_digest
from tasks.stages.capture_files import capture_digest
from tasks.stages.stage import Cell, code_versions

NUDGE = 1e-6  # of the points' spread
RENDERED_SECONDS = 0.25  # a quarter of what the pipeline times: runs are many
UNTIMED = {"fps": 1.0, "calibration": 1.0, "fps_calibrated": 1.0, "fps_noise": 0.0}
EVERY = 10_000  # of training views only the first is scored: the gate reads names alone

Scenes = Sequence[tuple[Scene, MaskReport]]


def make_scene(
    capture: CaptureConfig, config: BenchmarkConfig, out: Path, *, threads: int = 1
) -> tuple[Scene, MaskReport]:
    """Prepare, cut out and find points into ``out``."""
    prepared = prepare(capture, out / "prepared", test_every=config.test_every)
    masks = segment(prepared, config.segment, out / "masks", threads=threads)
    folder = out / "scene"
    return reconstruct(
        prepared, out / "masks" / "masks", config.sfm, folder, threads=threads
    ), masks


def shrunk(scene: Scene, resolution: int, out: Path) -> Scene:
    """Return the scene with photos and masks stored at ``resolution``, the same at every reading.

    Every experiment reads all photos; small ones are read in a tenth of the time. Labels of small
    structures are left out.
    """
    views = []
    for view in scene.views:
        size = size_at(view.width, view.height, resolution)
        photo = _resized(view.photo, size, out / "photos" / f"{view.name}.png")
        mask, coverage = (
            path and _resized(path, size, out / kind / f"{view.name}.png")
            for kind, path in (("mask", view.mask), ("coverage", view.coverage))
        )
        small = replace(view, width=size[0], height=size[1], photo=photo, mask=mask)
        camera = view.camera and view.camera.scaled(*size)
        views.append(replace(small, camera=camera, coverage=coverage, ids=None))
    found = replace(scene, folder=out, views=tuple(views))
    found.save(scene.points())
    return found


def nudged(scene: Scene, folder: Path, seed: int) -> Scene:
    """Return the scene with its points moved by a millionth, kept in ``folder``."""
    points = scene.points()
    step = NUDGE * points.xyz.std()
    moved = points.xyz + np.random.default_rng(seed).normal(0, step, points.xyz.shape)
    folder.mkdir(parents=True)
    shutil.copy(scene.folder / "scene.json", folder)  # the training's digest reads it
    np.savez(folder / "points.npz", **vars(replace(points, xyz=moved)))
    return replace(scene, folder=folder)


def _resized(photo: Path, size: tuple[int, int], target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(photo) as image:
        pixels = cv2.resize(np.asarray(image), size, interpolation=cv2.INTER_AREA)
    Image.fromarray(pixels).save(target)
    return target


def trained(
    config: BenchmarkConfig, cell: Cell, scene: Scene, out: Path
) -> tuple[Condition, TrainingReport]:
    """Train one experiment's splats into ``out``."""
    condition = Condition.parse(cell.condition)
    report = train(
        scene,
        condition,
        config.method(condition.method),
        config.train,
        iterations=config.iterations,
        resolution=config.resolution,
        seed=cell.seed,
        out=out,
    )
    return condition, report


def experiment(
    config: BenchmarkConfig,
    cell: Cell,
    scene: Scene,
    masks: MaskReport,
    out: Path,
    *,
    speed: dict[str, float] | None = None,
) -> Row:
    """Train, render, score and measure one experiment; ``speed`` instead of measuring it."""
    _, training = trained(config, cell, scene, out)
    row = evaluated(config, cell, scene, masks, out, laps=list(training.laps), speed=speed)
    return row | {"seconds": {"train": training.wall_seconds}}


def timed_again(
    config: BenchmarkConfig, row: Row, cell: Cell, scene: Scene, out: Path, *, fewest_seconds: float
) -> Row:
    """Train and measure one experiment again; return its row with the new speeds.

    Scores stay: the same code comes to the same bits. At least ``fewest_seconds`` of renderings and
    workloads are timed.
    """
    condition, training = trained(config, cell, scene, out)
    splats, laps = out / "splats.ply", list(training.laps)
    shown = config.resolution
    speed = measure_speed(scene, splats, condition, shown, fewest_seconds=fewest_seconds)
    time = {"time": sum(lap["value"] for lap in laps)}
    return row | {
        "metrics": row["metrics"] | time | speed,
        "repeats": {"time": laps},
        "seconds": {"train": training.wall_seconds},
    }


def evaluated(
    config: BenchmarkConfig,
    cell: Cell,
    scene: Scene,
    masks: MaskReport,
    out: Path,
    *,
    laps: list[dict[str, float]],
    speed: dict[str, float] | None = None,
) -> Row:
    """Render, score and measure the splats in ``out``; return their row."""
    condition, ply = Condition.parse(cell.condition), out / "splats.ply"
    render_views(scene, ply, condition, config.resolution, out, train_every=EVERY)
    found = score(out)
    if speed is None:
        speed = measure_speed(scene, ply, condition, config.resolution)
    capture = next(c for c in config.captures if c.name == cell.capture)
    seconds = sum(lap["value"] for lap in laps)
    return {
        "schema": 1,
        "protocol": PROTOCOL,
        "benchmark": config.name,
        "capture": cell.capture,
        "condition": cell.condition,
        "background": condition.background,
        "method": condition.method,
        "seed": cell.seed,
        "iterations": config.iterations,
        "resolution": config.resolution,
        "status": "finished",
        "reason": None,
        "metrics": found["metrics"] | {"time": seconds} | speed,
        "per_view": [view for view in found["per_view"] if view["split"] == "test"],
        "trained_on": sorted(TrainingReport.load(out).trained_on),
        "repeats": {"time": laps},
        "registration": dict(scene.extra),
        "masks": {"mean_iou": masks.mean_iou, "source": masks.source},
        "provenance": _provenance(config, cell, capture),
        "digests": {
            "segment": masks_digest(next(v.mask.parent for v in scene.views if v.mask)),
            "split": split_digest({view.name: view.split for view in scene.views}),
            **{name: found["digests"][name] for name in ("truth", "masks")},
        },
        "artifacts": {},
    }


def _provenance(config: BenchmarkConfig, cell: Cell, capture: CaptureConfig) -> dict[str, Any]:
    return _machine() | {
        "code_version": json_digest(code_versions()),
        "config_digest": config_digest(config, cell),
        "inputs": {"capture": capture_digest(capture)},
    }


@cache
def _machine() -> dict[str, Any]:
    """Return what this process runs on; its calibration takes a while."""
    return provenance.describe(threads=1)


def write_rows(rows: list[Row], path: Path) -> None:
    """Write rows as the command line reads them."""
    path.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def make_scenes(
    config: BenchmarkConfig, out: Path, threads: int, *, small: bool
) -> list[tuple[Scene, MaskReport]]:
    """Return the captures' scenes, made with so many threads; ``small``: photos at the resolution.

    Of small photos the truth without background is another: it is composited after shrinking.
    """
    scenes = []
    for capture in config.captures:
        folder = out / f"{capture.name}-{threads}-{os.getpid()}"
        scene, masks = make_scene(capture, config, folder, threads=threads)
        if small:
            scene = shrunk(scene, config.resolution, folder / "small")
        scenes.append((scene, masks))
    return scenes


def run(config: BenchmarkConfig, scenes: Scenes, out: Path) -> list[Row]:
    """Run all experiments once, without timing."""
    return [
        experiment(config, cell, *scene, _folder(out, cell), speed=UNTIMED)
        for cell, scene in _all_cells(config, scenes)
    ]


def time_again(
    config: BenchmarkConfig, rows: Sequence[Row], scenes: Scenes, out: Path
) -> list[Row]:
    """Return the rows of the same points, in any order, with speeds of another run."""
    found = {(row["capture"], row["condition"], row["seed"]): row for row in rows}
    return [
        timed_again(
            config,
            found[cell.capture, cell.condition, cell.seed],
            cell,
            scene,
            _folder(out, cell),
            fewest_seconds=RENDERED_SECONDS,
        )
        for cell, (scene, _) in _all_cells(config, scenes)
    ]


def _all_cells(
    config: BenchmarkConfig, scenes: Scenes
) -> Iterator[tuple[Cell, tuple[Scene, MaskReport]]]:
    for capture, scene in zip(config.captures, scenes, strict=True):
        for cell in cells(config, capture.name):
            yield cell, scene


def _folder(out: Path, cell: Cell) -> Path:
    return out / f"{cell.capture}-{cell.condition}-{cell.seed}"
