"""An attempt under way: its settings, its clocks and its progress bar; and which may follow it.

Worker process only.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.scene import FROM_OBJECT
from mattgs_ops.config import SfmConfig
from mattgs_ops.progress import Progress
from mattgs_ops.sfm.colmap.features import FAINT, Features, Matches, Pair
from mattgs_ops.sfm.colmap.job import KEYPOINTS_FILE, Answer, Job
from mattgs_ops.sfm.lost_views import MOST_VIEWS

# Each step's share of the work, for one bar over all of them (measured at 72 views, 800×600)
SHARES = {"extract": 0.3, "match": 0.3, "map": 0.23, "guide": 0.13, "triangulate": 0.04}
UNITS = 1000
COLMAP_KEEPS = 8192  # key points of a photo, COLMAP's own default: what later attempts keep


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


@dataclass(frozen=True)
class Further:
    """A later attempt: ``what`` is new in it, its job, its settings, and ``Extraction.thorough``.

    It is made where fewer than a share ``below`` of the views registered. ``afresh``: what earlier
    attempts found out about the object's motion does not hold in it.
    """

    what: str
    job: Job
    config: SfmConfig
    thorough: bool = False
    below: float = MOST_VIEWS
    afresh: bool = False

    def answer(self, best: Answer, step: str) -> Answer:
        """Return the answer that it fills in after the ``best`` so far; ``step`` says why."""
        again = Answer(self.config.mode if self.afresh else best.mode, threads=best.threads)
        again.seconds, again.cpu_seconds = dict(best.seconds), dict(best.cpu_seconds)
        before = [one for one in best.fallbacks if not (self.afresh and FROM_OBJECT in one)]
        again.fallbacks = [*before, step]
        return again

    def in_vain(self, best: Answer, again: Answer, step: str) -> list[str]:
        """Return the steps taken where ``again``, its answer, has no more views than the best."""
        before = [*best.fallbacks, step] if self.afresh else again.fallbacks
        return [*before, "no more views registered that way; not used"]


def further_attempts(job: Job) -> list[Further]:
    """Return the attempts that follow where too few views registered; none with known poses.

    The first keeps as many key points as COLMAP does, down to the smallest scales, and compares all
    pairs, as COLMAP does; up to ``similar_limit`` views. The second, which takes longer, seeks
    fainter ones, too, and those of surfaces seen aslant. Where all started from EXIF's focal length
    and the stage would fail (``min_registered``), a last one does as that without it: a focal
    length that is a few times too long or too short mends itself, and one far off places next to
    nothing.
    """
    if job.poses_known:
        return []
    config = job.sfm
    all_pairs = config.matcher == "auto" and len(job.views) <= config.similar_limit
    most = max(COLMAP_KEEPS, config.max_features)
    pairs = "all pairs compared" if all_pairs else f"pairs as before ({config.matcher})"
    more = {
        "matcher": "exhaustive" if all_pairs else config.matcher,
        "upsample": True,
        "max_features": most,
    }
    fainter = {**more, "peak_threshold": FAINT * config.peak_threshold}
    out = [
        Further(f"up to {most:,} key points kept, {pairs}", job, config.model_copy(update=more)),
        Further(
            f"fainter key points of affine shapes sought by COLMAP's SIFT, up to {most:,} kept",
            job,
            config.model_copy(update=fainter),
            thorough=True,
        ),
    ]
    if told := job.exif_focal:
        out.append(
            replace(
                out[-1],
                what=f"{told} left aside, otherwise as before",
                job=job.without_exif_focal(),
                below=config.min_registered,
                afresh=True,
            )
        )
    return out
