"""Put a row into the registry; a registry that fails never costs a finished experiment."""

import glob
import logging
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mattgs_ops.capture.scene import Scene
from mattgs_ops.capture.source import BUNDLED_FOLDER
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.naming import slug
from mattgs_ops.segment import sheet
from mattgs_ops.timing.machine_load import LOAD_FILE
from tasks.registry import interface_view, promotion, runs, summary
from tasks.registry.content.about import About
from tasks.registry.live_curves import CURVE_FILE, read_points
from tasks.registry.upkeep import orphans
from tasks.registry.upkeep.moved import ARTIFACTS
from tasks.row import Row, scene_of
from tasks.stages.stage import KEY_LETTERS, Artifact, Cell, Place

# Stage → what of its folder a run keeps → the folder in the run ("": the top)
KEPT = {
    "train": {
        "splats.ply": "",
        "training.json": "",
        "trainer.json": "",
        CURVE_FILE: "",
        LOAD_FILE: "",
        "start.npz": "",
        "pruned.npz": "",
        "exposures.json": "",
    },
    "evaluate": {
        "evaluation.json": "",
        "views.json": "",
        "renders": "renders",
        "truth/test": "truth/test",
        "masks/test": "masks/test",
    },
    "segment": {"masks.json": "scene"},
    "sfm": {"scene.json": "scene", "points.npz": "scene", "sfm.png": "scene", "sfm.log": "logs"},
    # where views voted, theirs are the masks and the points that trainings start from
    "agree": {"masks.json": "scene", "scene.json": "scene", "points.npz": "scene"},
}


def about_run(
    place: Place,
    config: BenchmarkConfig,
    cell: Cell,
    command: str,
    artifacts: dict[str, Artifact] | None = None,
) -> About:
    """Return what MLflow shows of an experiment beside its row; dates are those of its training."""
    capture = next(c for c in config.captures if c.name == cell.capture)
    photos = (capture.path or BUNDLED_FOLDER / capture.name).resolve().as_uri()
    trained = (artifacts or {}).get("train")
    if trained is None:
        return About(photos, command)
    began = place.extra(trained).get("began")
    if began is None:  # made by an earlier version: its date is not known, its length is
        began = time.time() - trained.seconds
    return About(photos, command, began, began + trained.seconds)


def record(
    place: Place,
    tracking_uri: str,
    row: Row,
    settings: dict[str, Any],
    artifacts: dict[str, Artifact],
    about: About = runs.NOTHING,
) -> Row:
    """Log an experiment's row and files, splats and renders among them; its run stays open.

    Returns the row with its run's id, None where the registry failed.
    """
    try:
        experiment = runs.open_benchmark(
            tracking_uri,
            row["benchmark"],
            # a server that others share keeps files itself, where all can see them
            None if tracking_uri.startswith("http") else place.out / ARTIFACTS,
        )
        training = artifacts["train"].key if "train" in artifacts else None
        earlier = runs.recorded(tracking_uri, experiment, row, training)
        with tempfile.TemporaryDirectory(prefix="mattgs-sheet-") as copies:
            run_id = runs.record(
                tracking_uri,
                experiment,
                row,
                parameters=settings,
                curve=_points(place, artifacts, CURVE_FILE),
                load=_points(place, artifacts, LOAD_FILE),
                about=about,
                files=_files(place, row, artifacts, _uploaded(earlier), Path(copies)),
                training=training,
                final=False,
            )
    except Exception as error:  # whatever MLflow, its database or its server raise
        _warn(row, error)
        return row
    return row | {"run_id": run_id}


def close(tracking_uri: str, row: Row, recorded: Row, about: About = runs.NOTHING) -> Row:
    """Close the run that holds ``recorded`` with ``row``, which has what was measured last.

    Returns the row with its run's id.
    """
    if recorded["run_id"] is None:  # the registry failed, and said so
        return row
    row = row | {"run_id": recorded["run_id"]}
    try:
        runs.finish(tracking_uri, row, recorded, about)
    except Exception as error:  # whatever MLflow, its database or its server raise
        _warn(row, error)
    return row


def _warn(row: Row, error: Exception) -> None:
    logging.getLogger("mattgs").warning("%s was not logged to MLflow: %s", Cell.of(row), error)


def record_summary(
    place: Place, tracking_uri: str, benchmark: str, rows: list[Row], report: Path
) -> str | None:
    """Log a benchmark's rows and its report's folder to its summary run; never raises.

    ``report`` is the page, logged with all that lies beside it. Returns the page's address on the
    MLflow server; None where there is no server, or it failed.
    """
    try:
        experiment = runs.open_benchmark(tracking_uri, benchmark, place.out / ARTIFACTS)
        run_id = summary.record_summary(tracking_uri, experiment, benchmark, rows, report.parent)
    except Exception as error:  # whatever MLflow, its database or its server raise
        text = "the summary of %s was not logged to MLflow: %s"
        logging.getLogger("mattgs").warning(text, benchmark, error)
        return None
    file = f"{summary.REPORT_FOLDER}/{report.name}"
    return interface_view.file_address(tracking_uri, experiment, run_id, file)


def close_orphans(tracking_uri: str, benchmark: str) -> None:
    """Close runs that an earlier, killed run of this benchmark left open; never raises."""
    try:
        closed = orphans.close_orphans(tracking_uri, benchmark)
    except Exception as error:  # whatever MLflow, its database or its server raise
        text = "open runs of %s could not be looked through in MLflow: %s"
        logging.getLogger("mattgs").warning(text, benchmark, error)
        return
    if closed:
        text = "closed what an interrupted run left open in MLflow: %s"
        logging.getLogger("mattgs").info(text, ", ".join(closed))


def promoted(tracking_uri: str, benchmark: str) -> list[Row]:
    """Return the rows of a benchmark's promoted baselines; none where the registry failed."""
    try:
        return promotion.aliased_rows(tracking_uri, benchmark)
    except Exception as error:  # whatever MLflow, its database or its server raise
        text = "the baselines of %s could not be read from MLflow: %s"
        logging.getLogger("mattgs").warning(text, benchmark, error)
        return []


def _uploaded(row: Row | None) -> dict[str, str]:
    """Return the digests of the artifacts whose files a run with this row holds, by stage."""
    return dict(((row or {}).get("provenance") or {}).get("outputs") or {})


def _points(place: Place, artifacts: dict[str, Artifact], file: str) -> list[dict[str, float]]:
    if "train" not in artifacts:
        return []
    return read_points(place.folder(artifacts["train"]) / file)


def _files(
    place: Place, row: Row, artifacts: dict[str, Artifact], uploaded: dict[str, str], copies: Path
) -> Iterator[tuple[Path, str]]:
    """Yield what a run keeps, and where in the run: all that a report or a viewer needs.

    Artifacts whose digests are ``uploaded`` lie in the run already. ``copies`` is an empty folder
    for small copies of photos, which are made for this.
    """
    new = {name for name, artifact in artifacts.items() if uploaded.get(name) != artifact.digest}
    for stage, names in KEPT.items():
        if stage in new:
            folder = place.folder(artifacts[stage])
            for name, where in names.items():
                if (folder / name).exists():
                    yield folder / name, where
    if {"sfm", "agree"} & new:
        scene = place.folder(scene_of(artifacts))
        yield from _example(scene)
        sheet.write_copies(scene, copies)
        yield copies, f"scene/{sheet.FOLDER}"
    for stage, log in _logs(place, row, artifacts):
        if stage in new or stage not in artifacts:
            yield log, "logs"


def _example(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield the one photo and mask of the scene that figures show."""
    view = Scene.load(folder).example_view()
    for path in () if view is None else (view.photo, view.mask):
        if path is not None and path.is_file():
            yield path, f"scene/{path.relative_to(folder).parent.as_posix()}"


def _logs(place: Place, row: Row, artifacts: dict[str, Artifact]) -> Iterator[tuple[str, Path]]:
    """Yield each stage and its log; of one that failed the newest of its title."""
    cell = str(Cell.of(row))
    owners = dict.fromkeys(("segment", "sfm", "agree"), row["capture"])
    owners |= {"train": cell, "evaluate": cell}
    for stage, owner in owners.items():
        title = slug(f"{stage} {owner}")
        if stage in artifacts:
            digest = artifacts[stage].key.rpartition("/")[2]
            logs = list(place.logs.glob(f"{glob.escape(title)}-{digest[:KEY_LETTERS]}.log"))
        else:
            found = place.logs.glob(f"{glob.escape(title)}-{'[0-9a-f]' * KEY_LETTERS}.log")
            logs = sorted(found, key=lambda path: path.stat().st_mtime)[-1:]
        yield from ((stage, log) for log in logs)
