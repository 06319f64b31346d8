"""From a finished (or failed) experiment's folders to its row (``reports/rows/schema.py``).

A row holds numbers and references only; everything in it is read from the stages' own reports.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mattgs_ops.config import NO_RESULT, BenchmarkConfig, Condition
from mattgs_ops.object_masks import doubts
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.store.digests import file_digest, json_digest, pixels_digest
from mattgs_ops.store.provenance import git_commit
from tasks.stages.stage import Artifact, Cell, Place, code_versions

SCHEMA, PROTOCOL = 1, 2  # as in reports/rows/schema.py, which a test compares
# Stage → what a row calls its folder.
ARTIFACT_NAMES = {
    "prepare": "capture",
    "segment": "masks",
    "sfm": "scene",
    "agree": "scene",
    "train": "train",
    "evaluate": "evaluate",
}
TRAINER_FILE = "trainer.json"  # mattgs_ops/trainers/train.py, as slow to import
EXPOSURES_FILE = "exposures.json"  # mattgs_ops/splat/exposure.py, which takes seconds to import
Row = dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """How one experiment's stages ended: what they made, and why they stopped if they did."""

    cell: Cell
    artifacts: dict[str, Artifact] = field(default_factory=dict)
    reason: str | None = None


def settings(config: BenchmarkConfig, cell: Cell) -> dict[str, Any]:
    """Return everything configured that this experiment depends on, nested, as JSON values.

    Where its files lie, and what runs beside it, is no part of it.
    """
    condition = Condition.parse(cell.condition)
    capture = next(c for c in config.captures if c.name == cell.capture)
    model = config.segment.model
    values = config.model_dump(
        mode="json",
        include={
            "iterations",
            "resolution",
            "test_every",
            "segment",
            "sfm",
            "train",
            "train_views",
        },
    )
    training = config.train_settings(cell.capture, cell.budget)
    values["train"] |= {"exposure": training.exposure, "max_splats": training.max_splats}
    values["segment"]["model"] = "bundled" if model is None else file_digest(model)
    if config.lpips is not None:
        values["lpips"] = file_digest(config.lpips)
    return {
        "capture": cell.capture,
        "capture_kind": "bundled" if capture.path is None else capture.kind,
        "background": condition.background,
        "method": condition.method,
        "seed": cell.seed,
        **({} if cell.budget is None else {"budget": cell.budget}),
        "method_settings": config.method_settings(condition.method),
        **values,
    }


def make_row(place: Place, config: BenchmarkConfig, outcome: Outcome) -> Row:
    """Return the experiment's row; its rendering speed joins it later (``tasks/measure.py``)."""
    cell, artifacts = outcome.cell, outcome.artifacts
    condition = Condition.parse(cell.condition)
    row: Row = {
        "schema": SCHEMA,
        "protocol": PROTOCOL,
        "benchmark": config.name,
        "capture": cell.capture,
        "condition": cell.condition,
        "background": condition.background,
        "method": condition.method,
        "seed": cell.seed,
        **({} if cell.budget is None else {"budget": cell.budget}),
        "iterations": config.iterations,
        "resolution": config.resolution,
        "status": "finished" if outcome.reason is None else "failed",
        "reason": outcome.reason,
        "metrics": {},
        "per_view": [],
        "registration": None,
        "masks": None,
        "warnings": [],
        "provenance": _provenance(place, config, outcome),
        "digests": _digests(place, artifacts),
        "artifacts": _references(place, artifacts),
        "seconds": {name: round(a.seconds, 3) for name, a in artifacts.items()},
        "run_id": None,
    }
    if "segment" in artifacts:
        row["masks"] = _masks(place.folder(artifacts.get("agree", artifacts["segment"])))
        row["warnings"] = _warnings(place, artifacts)
    if "sfm" in artifacts:
        row["registration"] = _registration(place.folder(artifacts["sfm"]))
    if outcome.reason is None:
        row |= _scores(place, artifacts)
        row["masks"] = (row["masks"] or {}) | {"scored": _evaluation(place, artifacts)["masks"]}
    return row


def _digests(place: Place, artifacts: Mapping[str, Artifact]) -> dict[str, str]:
    """Return digests of what scores hang on, and of each stage that may have changed it.

    Of masks the pixels count: a stage's own digest holds its seconds too.
    """
    found = {}
    if "prepare" in artifacts:
        found["prepare"] = artifacts["prepare"].digest
    for stage, masks in (("segment", "masks"), ("agree", "masks")):
        if stage in artifacts:
            found[stage] = masks_digest(place.folder(artifacts[stage]) / masks)
    if "sfm" in artifacts:
        views = _read(place.folder(scene_of(artifacts)) / "scene.json")["views"]
        found["split"] = split_digest({view["name"]: view["split"] for view in views})
    if "evaluate" in artifacts:
        evaluation = _evaluation(place, artifacts)
        found |= {name: evaluation["digests"][name] for name in ("truth", "masks")}
    return found


@lru_cache(maxsize=64)
def masks_digest(folder: Path) -> str:
    """Return the digest of the masks in a finished stage's folder, by their pixels."""
    return pixels_digest(
        (path.name, np.asarray(Image.open(path))) for path in sorted(folder.glob("*.png"))
    )


def split_digest(views: Mapping[str, str]) -> str:
    """Return the digest of which views are held out; ``views`` maps names to splits."""
    return json_digest(dict(views))


def scene_of(artifacts: Mapping[str, Artifact]) -> Artifact:
    """Return the scene that trainings start from: with masks that agree, where views voted."""
    return artifacts.get("agree", artifacts["sfm"])


def _references(place: Place, artifacts: Mapping[str, Artifact]) -> dict[str, str]:
    """Say where each stage's folder is; agreed masks lie in the scene they belong to."""
    found = {ARTIFACT_NAMES[name]: place.reference(a) for name, a in artifacts.items()}
    if "agree" in artifacts:
        found |= {"masks": found["scene"], "saliency": place.reference(artifacts["segment"])}
        found["solved"] = place.reference(artifacts["sfm"])
    return found


def running_row(place: Place, config: BenchmarkConfig, cell: Cell, prepared: Artifact) -> Row:
    """Return the row of an experiment that has not ended: what is known of it from the start."""
    row = make_row(place, config, Outcome(cell, {"prepare": prepared}, reason="running"))
    return row | {"status": "running", "reason": None}


def _provenance(place: Place, config: BenchmarkConfig, outcome: Outcome) -> dict[str, Any]:
    """Say what the row came from: code, configuration, photos, outputs, the training's machine."""
    digests = {name: artifact.digest for name, artifact in outcome.artifacts.items()}
    prepared, trained = outcome.artifacts.get("prepare"), outcome.artifacts.get("train")
    # the capture's own files, not the prepared ones, whose bytes depend on a library's compression
    files = {} if prepared is None else place.extra(prepared).get("inputs", {})
    prepared_digest = digests.pop("prepare", None)
    return {
        "code_version": json_digest(code_versions()),
        "config_digest": config_digest(config, outcome.cell),
        "inputs": {"capture": files.get("files", prepared_digest)},
        "outputs": digests,
        **({"git": git_commit()} if trained is None else place.extra(trained).get("machine", {})),
        **_trainer(place, trained),
    }


def _trainer(place: Place, trained: Artifact | None) -> dict[str, Any]:
    """Say which program trained, where it was not this one."""
    path = None if trained is None else place.folder(trained) / TRAINER_FILE
    return {} if path is None or not path.is_file() else {"trainer": _read(path)}


def config_digest(config: BenchmarkConfig, cell: Cell) -> str:
    """Return SHA-256 of the user's settings: all that differs from the defaults.

    Defaults are code, and ``code_version`` covers them: so a new setting changes no digest, and a
    wrong default is judged by what it does to the scores instead of being called another
    configuration.
    """
    requested = settings(config, cell)
    changed = config.model_dump(
        mode="json",
        include={"test_every", "segment", "sfm", "train", "train_views"},
        exclude_defaults=True,
    )
    for name in NO_RESULT:
        changed.get("train", {}).pop(name, None)
    changed = {name: value for name, value in changed.items() if value != {}}
    if "model" in changed.get("segment", {}):
        changed["segment"]["model"] = requested["segment"]["model"]
    if "lpips" in requested:
        changed["lpips"] = requested["lpips"]
    trainer = config.trainers.get(requested["method"])
    own = trainer or config.methods.get(requested["method"])
    places = None if trainer is None else {"folder", "timeout"}
    method = (
        None if own is None else own.model_dump(mode="json", exclude_defaults=True, exclude=places)
    )
    kept = ("capture", "capture_kind", "background", "method", "seed", "iterations", "resolution")
    return json_digest(
        {name: requested[name] for name in kept}
        | changed
        | {"method_settings": method}
        | ({} if cell.budget is None else {"budget": cell.budget})
    )


def _scores(place: Place, artifacts: dict[str, Artifact]) -> dict[str, Any]:
    """Join scores and training time."""
    training = _read(place.folder(artifacts["train"]) / "training.json")
    evaluation = _evaluation(place, artifacts)
    metrics = dict(evaluation["metrics"])
    metrics |= {"time": training["wall_seconds"], "time_cpu": training["cpu_seconds"]}
    found: dict[str, Any] = {"metrics": metrics, "per_view": evaluation["per_view"]}
    found["capped"] = (training.get("counters") or {}).get("capped", 0)
    found["trained_on"] = _trained_on(training, place.folder(scene_of(artifacts)))
    # laps of a training and the fixed workload in turns; a resumed one has none
    return found | ({"repeats": {"time": training["laps"]}} if training["laps"] else {})


def _evaluation(place: Place, artifacts: Mapping[str, Artifact]) -> dict[str, Any]:
    return _read(place.folder(artifacts["evaluate"]) / "evaluation.json")


def _trained_on(training: Mapping[str, Any], scene: Path) -> list[str]:
    """Return the names of all photos that were trained on; by the scene if no trainer says so."""
    views = _read(scene / "scene.json")["views"]
    given = [view["name"] for view in views if view["split"] == "train" and view["camera"]]
    return sorted(training.get("trained_on") or given)


def _masks(folder: Path) -> dict[str, Any]:
    report = _read(folder / "masks.json")
    flagged = [view["name"] for view in report["views"] if view["flags"]]
    means = report.get("means") or {}
    return {
        "source": report["source"],
        "mean_iou": report["mean_iou"],
        "model": report["model"],
        "flagged": flagged,
        "means": means,
    }


def _warnings(place: Place, artifacts: Mapping[str, Artifact]) -> list[dict[str, Any]]:
    """Return what is in doubt of masks, poses and photos: ``about``, ``text``, ``serious`` each."""
    masks = place.folder(artifacts.get("agree", artifacts["segment"]))
    solved = "sfm" in artifacts
    extra = _read(place.folder(scene_of(artifacts)) / "scene.json")["extra"] if solved else {}
    found = doubts.of_masks(MaskReport.load(masks / "masks.json"), extra)
    found += doubts.of_poses(extra)
    exposures = "train" in artifacts and place.folder(artifacts["train"]) / EXPOSURES_FILE
    if exposures and exposures.is_file():
        found += doubts.of_exposure(_read(exposures)["spread"])
    return [asdict(one) for one in found]


def _registration(folder: Path) -> dict[str, Any]:
    """Return what structure-from-motion reported.

    ``missing`` names test views without a pose, ``unregistered`` all views without one, and
    ``lost`` says how many key points each of those had.
    """
    scene = _read(folder / "scene.json")
    lost = [view for view in scene["views"] if view["camera"] is None]
    missing = [view["name"] for view in lost if view["split"] == "test"]
    names = {"missing": missing, "unregistered": [view["name"] for view in lost]}
    return {**scene["extra"], **names, "lost": scene["extra"].get("missing", [])}


def _read(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return data
