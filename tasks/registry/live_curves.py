"""Training curves and system metrics in MLflow while the trainings run.

Trainings write both to files; one thread of the flow reads what is new and logs it. So no training
waits for a database, twelve of them do not write to it at once, and the process that trains never
imports MLflow. A file belongs to the training that its stage's key names: what a killed training
left behind is ignored. Where workers keep their files on another machine nothing is followed: the
row that ends an experiment brings the complete curve. A registry that fails ends the following with
a warning, and nothing else.
"""

import csv
import logging
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mattgs_ops.store.store import Store
from mattgs_ops.timing.machine_load import LOAD_FILE
from tasks.registry import runs
from tasks.registry.content.about import About
from tasks.registry.upkeep.moved import ARTIFACTS
from tasks.row import Row
from tasks.stages.process import StageJob
from tasks.stages.stage import Place

LOOK_EVERY = 5.0  # seconds; MLflow's interface asks for new points every thirty
CURVE_FILE = "curve.csv"


@dataclass(frozen=True)
class Expected:
    """An experiment that may be trained: its row so far, its settings, its photos and command."""

    row: Row
    settings: Mapping[str, Any]
    about: About = runs.NOTHING


@contextmanager
def following(
    place: Place, tracking_uri: str, expected: Mapping[str, Expected], every: float = LOOK_EVERY
) -> Iterator[None]:
    """Log curves of the trainings of this benchmark that run meanwhile.

    ``expected`` maps titles of training stages to their experiments.
    """
    follower = _Follower(place, tracking_uri, expected, every)
    follower.start()
    try:
        yield
    finally:
        follower.end()


class _Follower(threading.Thread):
    def __init__(
        self, place: Place, tracking_uri: str, expected: Mapping[str, Expected], every: float
    ) -> None:
        super().__init__(name="curves", daemon=True)
        self._place, self._uri, self._expected, self._every = place, tracking_uri, expected, every
        self._over = threading.Event()
        self._runs: dict[str, str] = {}  # key of a training → run
        self._seen: dict[tuple[str, str], int] = {}  # key of a training, file → last step logged

    def run(self) -> None:
        try:
            while not self._over.wait(self._every):
                for job in running_trainings(self._place):
                    self._log(job)
        except Exception as error:  # whatever MLflow, its database or its server raise
            text = "training curves are not followed any more: %s"
            logging.getLogger("mattgs").warning(text, error)

    def end(self) -> None:
        """Stop; a call to the registry that is under way is finished first."""
        self._over.set()
        self.join()

    def _log(self, job: StageJob) -> None:
        experiment = self._expected.get(job.title)
        if experiment is None:
            return
        curve = self._new(job, CURVE_FILE)
        if not curve and job.key not in self._runs:
            return
        if job.key not in self._runs:
            place = self._place.out / ARTIFACTS
            opened = runs.open_benchmark(self._uri, experiment.row["benchmark"], place)
            about = replace(experiment.about, began=job.began or None)
            self._runs[job.key] = runs.begin(
                self._uri,
                opened,
                experiment.row,
                experiment.settings,
                about=about,
                training=job.key,
            )
        runs.log_curve(self._uri, self._runs[job.key], curve)
        runs.log_load(self._uri, self._runs[job.key], self._new(job, LOAD_FILE))

    def _new(self, job: StageJob, file: str) -> list[dict[str, float]]:
        """Return the points of a training's file that were not returned before."""
        found = read_points(job.out / file)
        new = [point for point in found if point["step"] > self._seen.get((job.key, file), 0)]
        if new:
            self._seen[job.key, file] = int(new[-1]["step"])
        return new


def running_trainings(place: Place) -> list[StageJob]:
    """Return the trainings of this benchmark that run on files we can see."""
    jobs = []
    for path in sorted(place.logs.glob("train-*.job.json")):
        try:
            job = StageJob.load(path)
        except (OSError, ValueError, TypeError, KeyError):
            continue  # it has just ended, or is just being written
        if job.status.parent == place.status and _at_work(place, job):
            jobs.append(job)
    return jobs


def _at_work(place: Place, job: StageJob) -> bool:
    """Whether somebody holds the lock of the job's key; a killed process leaves the job alone."""
    if not job.key:  # written by an earlier version of this project
        return False
    with Store(place.store).lock(job.key, wait=False) as free:
        return not free


def read_points(path: Path) -> list[dict[str, float]]:
    """Read a curve or a load, one mapping per line with ``step``; empty while there is none.

    The last line may still be half written: it counts only with its end.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        return []
    complete = text[: text.rfind("\n") + 1].splitlines()
    return [{key: float(value) for key, value in line.items()} for line in csv.DictReader(complete)]
