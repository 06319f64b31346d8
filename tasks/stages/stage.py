"""One stage of one experiment: looked up in the store, else done, and kept.

:func:`perform` is what every stage task calls. A finished stage is never repeated; two flows never
do it at once; an interrupted one goes on in its work folder. What passes between tasks is an
:class:`Artifact`, a reference into the store; folders never travel.
"""

import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from socket import gethostname
from typing import Any

from mattgs_ops.config import RunConfig
from mattgs_ops.errors import StageError
from mattgs_ops.naming import slug
from mattgs_ops.store import provenance
from mattgs_ops.store.code_version import STAGES, TRAINERS, TRUTH, code_version, digest_modules
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.store import Finished, Slot, Store
from tasks.stages import cores, process, quiet, travelling
from tasks.stages.run_log import RunLog
from tasks.stages.source_times import SourceTimes, source_times
from tasks.stages.status import StatusFile, read

PACKAGE = "mattgs-bench"
KEY_LETTERS = 8  # of a key, in names of log files
WORK_FOLDER = "MATTGS_WORK"  # environment variable of workers that do not see the output folder


@dataclass(frozen=True)
class Cell:
    """One experiment of a benchmark's grid; prints as people say it.

    ``budget`` is the most splats that it may have, where the grid has budgets.
    """

    capture: str
    condition: str
    seed: int
    budget: int | None = None

    def __str__(self) -> str:
        return f"{self.capture} {self.label}"

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> "Cell":
        """Return the experiment that a row is of."""
        return cls(row["capture"], row["condition"], int(row["seed"]), row.get("budget"))

    @property
    def label(self) -> str:
        """What tells it from the capture's others."""
        limit = "" if self.budget is None else f" {self.budget} splats"
        return f"{self.condition}{limit} seed {self.seed}"


@dataclass(frozen=True)
class Artifact:
    """A finished stage: its key, the digest of what it produced, and what that took.

    ``seconds`` are those of the run that produced it; ``cached`` says that this was not now.
    """

    stage: str
    key: str
    digest: str
    seconds: float
    cached: bool


@dataclass(frozen=True)
class Place:
    """Where a benchmark works. Never part of a key: another place, the same results.

    ``out`` is the flow's folder. A worker that does not see it names its own in ``MATTGS_WORK`` and
    gets artifacts through the store of ``run.store``. ``captures`` is how many share the machine;
    where it is known, stages of one capture that can be spread take its share of the cores.
    ``version`` is the flow's of this package: a worker that has another does nothing.
    """

    out: Path
    benchmark: str
    run: RunConfig = field(default_factory=RunConfig)
    captures: int | None = None
    version: str = ""

    @property
    def store(self) -> Path:
        """Folder of the finished stages."""
        return self.here / "store"

    @property
    def here(self) -> Path:
        """Folder on this machine for stages, status and logs."""
        return Path(os.environ.get(WORK_FOLDER) or self.out)

    def threads(self, *, spreads: bool) -> tuple[int, int]:
        """Return the threads that a stage needs, and the most that it may have."""
        most = self.run.threads
        if spreads and self.captures is not None:
            most = max(most, cores.own_cores() // self.captures)
        return self.run.threads, most

    def open_store(self) -> Store:
        """Return the store, with the one that machines share where there is one."""
        return Store(self.store, self.run.store)

    @property
    def status(self) -> Path:
        """Folder of the status files."""
        return self.here / "status" / self.benchmark

    @property
    def logs(self) -> Path:
        """Folder of the stages' logs."""
        return self.here / "logs"

    def reference(self, artifact: Artifact) -> str:
        """Return where an artifact's files lie, relative to the store."""
        store = Store(self.store)
        return str(store.folder(artifact.key).relative_to(store.root))

    def folder(self, artifact: Artifact) -> Path:
        """Return the local folder of an artifact's files, brought here where need be."""
        if self.run.store is None:
            return Store(self.store).folder(artifact.key)
        return self.open_store().fetch(artifact.key).folder

    def extra(self, artifact: Artifact) -> Mapping[str, Any]:
        """Return what was noted when the artifact was made: seconds, threads, the machine."""
        found = Store(self.store).find(artifact.key, contents=False)
        return {} if found is None else found.extra


@dataclass(frozen=True)
class Stage:
    """What to do.

    ``parameters`` and ``inputs`` (name → digest) make the key, with the code's version;
    ``arguments`` are what ``operation`` (``MODULE:FUNCTION``) is called with, and may hold paths.
    ``imports``: modules that it needs and that start no threads, see :class:`process.StageJob`;
    ``spreads``: more threads make it faster, and nothing compares its time;
    ``resumes``: the operation goes on from what an interrupted attempt left in its work folder,
    once the file of this name is there; ``counts``: the JSON file of its results whose
    ``wall_seconds`` count interrupted attempts too; ``alone``: it waits until nothing else runs on
    this machine; ``modules``: the code that counts as the stage's, where that is not the name's;
    ``timeout``: its own limit in seconds, where it has one.
    """

    name: str
    title: str
    operation: str
    parameters: Mapping[str, Any]
    inputs: Mapping[str, str]
    arguments: Mapping[str, Any]
    imports: tuple[str, ...] = ()
    spreads: bool = False
    resumes: str | None = None
    counts: str | None = None
    alone: bool = False
    modules: tuple[str, ...] = ()
    timeout: float | None = None


def perform(place: Place, stage: Stage) -> Artifact:
    """Return the stage's artifact, made now unless the store has it.

    Raises what the operation raised, and :class:`StageError` when its process crashed or was
    ended, or when this worker's version is not the flow's.
    """
    if place.version not in ("", own_version()):
        raise StageError(
            f"{stage.title}: the worker on {gethostname()} has {PACKAGE} {own_version()}, the flow "
            f"{place.version}; install the same version"
        )
    status = StatusFile(place.status / f"{slug(stage.title)}.json")
    code = _code_version(stage.name, stage.modules, source_times())
    key = stage_key(stage.name, code, stage.parameters, stage.inputs)
    before = read(status.path)
    made_beside = before is not None and before.state == "running"  # by another of this run's
    try:
        if not made_beside:
            status.begin(stage.title, stage.name, str(key))
        with place.open_store().stage(key, resume=stage.resumes is not None) as slot:
            cached = slot.finished is not None
            if made_beside and not cached:
                status.begin(stage.title, stage.name, str(key))
            finished = slot.finished or _make(place, stage, slot, status)
    except Exception as error:
        status.end("failed", str(error))
        raise
    if not cached:
        status.end("done")
    elif before is not None and before.state in ("done", "cached"):
        status.restore(before)  # asked for twice in one run: the first answer says what it took
    elif not made_beside:
        status.end("cached")
    seconds = float(finished.extra["seconds"])
    how = "found in the store, it took" if cached else "done in"
    RunLog().info(f"{stage.title}: {how} {seconds:.1f} s; {finished.folder}")
    return Artifact(stage.name, finished.key, finished.digest, seconds, cached)


def own_version() -> str:
    """Return the version of this package that is installed here."""
    return version(PACKAGE)


def _make(place: Place, stage: Stage, slot: Slot, status: StatusFile) -> Finished:
    with _turn(place, stage, status) as threads:
        date, began = time.time(), time.monotonic()
        job = process.StageJob(
            title=stage.title,
            operation=stage.operation,
            arguments=dict(stage.arguments),
            out=slot.work,
            log=place.logs / f"{slug(stage.title)}-{slot.key.digest[:KEY_LETTERS]}.log",
            status=status.path,
            threads=threads,
            timeout=stage.timeout or place.run.stage_timeout,
            imports=stage.imports,
            key=str(slot.key),
            began=date,
        )
        run_log = RunLog()
        run_log.info(f"{stage.title}: begins with {threads} threads; log: {job.log}")
        with _copied(place, stage, slot), run_log.following(job.log, job.status):
            process.run(job)
        seconds = round(max(time.monotonic() - began, _all_attempts(stage, slot.work)), 3)
    machine = provenance.describe(threads)
    made = {"seconds": seconds, "began": round(time.time() - seconds, 3), "machine": machine}
    return slot.finish(made | {"inputs": dict(stage.inputs)})


def _all_attempts(stage: Stage, work: Path) -> float:
    """Return the seconds that the stage itself counted, those before it was interrupted too."""
    if stage.counts is None:
        return 0.0
    return float(json.loads((work / stage.counts).read_text(encoding="utf-8"))["wall_seconds"])


@contextmanager
def _turn(place: Place, stage: Stage, status: StatusFile) -> Iterator[int]:
    """Wait until the stage may run on this machine; yields its threads."""
    mine = f"{place.benchmark} in {place.here}"

    def tell(holders: list[str], wanted: str = "a core") -> None:
        others = ", ".join(holder for holder in holders if holder not in (mine, ""))
        status.progress(0, 0, f"waiting for {wanted}{others and ', held by '}{others}")

    if stage.alone:
        tell(cores.holders(), "a quiet machine")
        with quiet.alone():
            status.progress(0, 0, "")
            yield place.run.threads
        return

    with (
        quiet.busy(lambda: status.progress(0, 0, "waiting until speed is measured")),
        cores.taken(*place.threads(spreads=stage.spreads), mine, tell) as threads,
    ):
        status.progress(0, 0, "")
        yield threads


def _copied(place: Place, stage: Stage, slot: Slot) -> AbstractContextManager[None]:
    if place.run.store is None or stage.resumes is None:
        return nullcontext()
    return travelling.copied(slot, stage.resumes, place.run.checkpoint_copy_every)


def code_versions() -> dict[str, str]:
    """Return the digest of the code behind each stage."""
    times = source_times()
    versions = {name: _code_version(name, (), times) for name in STAGES}
    others = {"trainer": TRAINERS, "truth": TRUTH}
    return versions | {name: _code_version(name, of, times) for name, of in others.items()}


@lru_cache(maxsize=32)
def _code_version(name: str, modules: tuple[str, ...], times: SourceTimes) -> str:
    """Digest a stage's code, again when a source was touched: its task's and all behind it.

    Where it names ``modules``, those and what is behind them.
    """
    del times
    return digest_modules(modules) if modules else code_version(name, f"tasks.{name}")
