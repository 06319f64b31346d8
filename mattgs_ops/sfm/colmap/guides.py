"""Matching along epipolar lines beside a growing model: which views and key points it is told of.

Worker process only.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.sfm.colmap import mapping
from mattgs_ops.sfm.colmap.features import Features, Matches, Pair
from mattgs_ops.sfm.colmap.guided_matching import Guide
from mattgs_ops.sfm.colmap.steps import Attempt

Rows = list[NDArray[np.int64]]  # some of each view's key points
Sets = dict[str, Rows]


def sets_of(found: Sequence[Features], mode: str) -> Sets:
    """Return the sets of key points that a mode matches, as rows of each view's key points."""
    whole = [np.flatnonzero(f.whole) for f in found]
    masked = [np.flatnonzero(f.masked) for f in found]
    return {
        "original": {"whole": whole},
        "masked": {"masked": masked},
        "shared": {"whole": whole, "masked": masked},
    }[mode]


class Guides:
    """The sets of key points that are matched along the epipolar lines of a model's poses."""

    def __init__(
        self, state: Attempt, found: Sequence[Features], sets: Sets, helpers: Executor | None
    ) -> None:
        self.state, self.found, self.sets = state, found, sets
        self.guides = {
            name: Guide([f.descriptors[r] for f, r in zip(found, rows, strict=True)], rows, helpers)
            for name, rows in sets.items()
        }

    def see(self, model: Any) -> None:
        """Take the poses of a growing model."""
        for name, guide in self.guides.items():
            guide.see(*self._training_views(model, self.sets[name]))

    def settle(self, models: Sequence[Any]) -> None:
        """Take the last poses of the first of ``models``; alone, it is the one that was seen."""
        for name, guide in self.guides.items():
            views = self._training_views(models[0], self.sets[name])
            guide.settle(*views, same=len(models) == 1)

    def finish(self) -> Iterator[dict[Pair, Matches]]:
        """Yield each set's matches."""
        state, answer = self.state, self.state.answer
        for name, guide in self.guides.items():
            with state.step("guide", guide.spent):
                out = guide.finish(lambda *told: state.report("guide", *told))
            answer.pairs[f"{name} guided"] = guide.pairs
            answer.matches[f"{name} guided"] = sum(map(len, out.values()))
            yield out

    def _training_views(
        self, model: Any, rows: Rows
    ) -> tuple[dict[int, Camera], dict[int, NDArray[np.float64]]]:
        """Return a model's training views and the rays of their key points ``rows``."""
        views, found = self.state.job.views, self.found
        cameras = {n: c for n, c in mapping.posed(model).items() if not views[n].held_out}
        return cameras, {n: mapping.rays_of(model, n, found[n].positions[rows[n]]) for n in cameras}


def beside(threads: int) -> AbstractContextManager[Executor | None]:
    """Return the threads that match while this one maps; None where there is but one."""
    return ThreadPoolExecutor(threads - 1) if threads > 1 else nullcontext()
