"""An attempt under way: its settings, its clocks and its progress bar. Worker process only."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.config import SfmConfig
from mattgs_ops.progress import Progress
from mattgs_ops.sfm.colmap.features import Features, Matches, Pair
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE, Answer, Job

# Each step's share of the work, for one bar over all of them (measured at 72 views, 800×600)
SHARES = {"extract": 0.3, "match": 0.3, "map": 0.23, "guide": 0.13, "triangulate": 0.04}
UNITS = 1000


@dataclass
class Attempt:
    """An attempt under way: its settings, what it says outside, what it remembers."""

    job: Job
    config: SfmConfig
    answer: Answer
    progress: Progress
    start: float = 0.0
    thorough: bool = False  # key points by COLMAP's slower SIFT
    number: int = 1  # each begins at 0 again
    whole_matches: dict[Pair, Matches] = field(default_factory=dict)  # of whole photos, verified

    @property
    def folder(self) -> Path:
        """Where the worker's files go."""
        return Path(self.job.workspace)

    @contextmanager
    def step(self, name: str, clock: Callable[[], float] = time.process_time) -> Iterator[None]:
        """Time a step and move the bar to its start; ``clock`` tells processor seconds."""
        began, worked = time.perf_counter(), clock()
        steps = list(SHARES)
        self.start = sum(SHARES[s] for s in steps[: steps.index(name)])
        yield
        for seconds, spent in (
            (self.answer.seconds, time.perf_counter() - began),
            (self.answer.cpu_seconds, clock() - worked),
        ):
            seconds[name] = seconds.get(name, 0.0) + spent

    def report(self, name: str, done: int, total: int, note: str) -> None:
        """Report ``done`` of ``total`` units of a step."""
        units = round(UNITS * (self.start + SHARES[name] * done / max(total, 1)))
        again = f"attempt {self.number}, " if self.number > 1 else ""
        self.progress(units, UNITS, f"{again}{name}: {note}")

    def write_keypoints(self, found: Sequence[Features], rows: Sequence[NDArray[np.int64]]) -> None:
        """Write all key points and the whole photos' matches, which are numbered among ``rows``.

        In the file matches are numbered among all key points of their views.
        """
        numbered = [
            np.stack([rows[i][m[:, 0]], rows[j][m[:, 1]]], axis=1)
            for (i, j), m in self.whole_matches.items()
        ]
        np.savez(
            self.folder / KEYPOINTS_FILE,
            names=np.array([view.name for view in self.job.views]),
            counts=np.array([len(f.inside) for f in found]),
            xy=np.concatenate([f.keypoints[:, :2] for f in found]),
            inside=np.concatenate([f.inside for f in found]),
            pairs=np.array(list(self.whole_matches), dtype=np.int64).reshape(-1, 2),
            pair_counts=np.array([len(m) for m in numbered], dtype=np.int64),
            matches=np.concatenate([np.zeros((0, 2), np.int64), *numbered]).astype(np.uint32),
        )
