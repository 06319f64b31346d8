"""Densification by the positional gradient, and the pruning of 3DGS and of MATT-GS.

MATT-GS's pruning acts where splats are added and removed: those with opacity below
``prune_opacity`` **and** an attention score below ``prune_attention`` go, unless opacities were
reset less than half an interval ago (:mod:`~mattgs_ops.splat.training.schedule`).
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from mattgs_ops.config import TrainConfig
from mattgs_ops.errors import StageError
from mattgs_ops.frozen import Background
from mattgs_ops.method import MethodConfig
from mattgs_ops.splat.photos import Floats
from mattgs_ops.splat.rasterize import Rendering, SplatStatistics
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.densify import (
    Record,
    faint_or_huge,
    grow,
    logit,
    prune,
    reset_opacity,
)
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.strategies.base import Strategy

Scores = Callable[[NDArray[np.float64]], Floats]  # points [P, 3] to attention scores [P]


class GradientStrategy(Strategy):
    """Kerbl et al. 2023; by ``method`` with AbsGS's gradient, a budget and MATT-GS's pruning."""

    def __init__(
        self,
        method: MethodConfig,
        config: TrainConfig,
        schedule: Schedule,
        extent: float,
        background: Background,
        scores_at: Scores,
    ) -> None:
        self._method, self._config, self._schedule = method, config, schedule
        self._extent, self._background, self._scores_at = extent, background, scores_at

    @override
    def statistics(self, step: int) -> bool:
        """Where the gradient is absolute or blending weights are scored."""
        wanted = self._method.wants_blending or self._method.densify == "absolute"
        return wanted and self._schedule.observes(step)

    @override
    def after_step(
        self, state: TrainingState, step: int, observed: SplatStatistics, rendering: Rendering
    ) -> None:
        """Observe; densify and reset opacities where that is due."""
        if self._schedule.observes(step):
            self._observe(state, observed, rendering)
        if self._schedule.densifies(step):
            self._densify(state, step)
        if self._schedule.resets(step):
            reset_opacity(state.splats, state.adam)

    def _observe(
        self, state: TrainingState, observed: SplatStatistics, rendering: Rendering
    ) -> None:
        """Note what this step saw of each splat, for the next densification."""
        height, width = rendering.alpha.shape
        means2d = observed.means2d_abs if self._method.densify == "absolute" else observed.means2d
        state.record.observe(means2d, rendering.radii, width, height)
        if self._method.wants_blending:
            state.record.weight += observed.weight
            state.record.attention += observed.weighted_map

    def _densify(self, state: TrainingState, step: int) -> None:
        if self._schedule.settled(step):
            self._prune_unattended(state, step)
            self._prune_idle(state, step)
        before = len(state.splats)
        threshold, most = self._threshold(state, step)
        state.splats = grow(
            state.splats,
            state.adam,
            state.record.gradients(),
            threshold,
            self._config.model_copy(update={"max_splats": most}),
            self._extent,
            state.streams["split"],
        )
        state.count("added", len(state.splats) - before)
        state.count("capped", int(len(state.splats) >= self._config.max_splats))
        huge = 0 < self._schedule.reset_every < step
        removed = faint_or_huge(state.splats, self._config, self._extent, huge=huge)
        state.count("removed_faint_or_huge", int(removed.sum()))
        state.splats = prune(state.splats, state.adam, removed)
        if len(state.splats) == 0:
            raise StageError(f"step {step}: every splat was removed; nothing is left to train")
        state.record = Record.empty(len(state.splats))
        state.count("densifications", 1)

    def _threshold(self, state: TrainingState, step: int) -> tuple[float, int]:
        """Return the gradient from which splats are added, and how many there may be then."""
        most = self._config.max_splats
        if self._method.growth == "budget":
            start = state.counters["starting_splats"]
            return 0.0, budget_at(step, start, most, self._schedule)
        if self._method.densify == "absolute":
            return self._method.absolute_threshold(self._background), most
        return self._config.densify_gradient, most

    def _prune_unattended(self, state: TrainingState, step: int) -> None:
        """Remove splats of low opacity and low attention."""
        if self._method.prune == "none":
            return
        faint = torch.zeros(len(state.splats), dtype=torch.bool)
        if self._method.prune_opacity > 0:
            faint = state.splats.opacity_logits < logit(self._method.prune_opacity)
        index = torch.nonzero(faint)[:, 0]
        if self._method.prune == "blend":
            scores = state.record.blend_scores()[index]
        else:
            means = state.splats.means[index].numpy().astype(np.float64)
            scores = torch.from_numpy(self._scores_at(means))
        removed = torch.zeros_like(faint)
        removed[index[scores < self._method.prune_attention]] = True
        _remove(state, removed, step, "removed_unattended")

    def _prune_idle(self, state: TrainingState, step: int) -> None:
        """Remove splats that hardly show in the views that see them."""
        if self._method.prune_contribution > 0:
            idle = state.record.contributions() < self._method.prune_contribution
            _remove(state, idle & (state.record.seen > 0), step, "removed_idle")


def budget_at(step: int, start: int, budget: int, schedule: Schedule) -> int:
    """Return how many splats there may be after ``step``: a parabola from start to budget.

    It is steep at first and flat at the last densification, so that most splats have most of the
    run to find their place. Never fewer than ``start``.
    """
    first, every = schedule.densify_from, schedule.densify_every
    last = (min(schedule.densify_until, schedule.iterations) - 1) // every * every
    share = min(max((step - first) / max(last - first, 1), 0.0), 1.0)
    return start + round((max(budget, start) - start) * (1 - (1 - share) ** 2))


def _remove(state: TrainingState, removed: Tensor, step: int, reason: str) -> None:
    state.count(reason, int(removed.sum()))
    means = state.splats.means[removed]
    at = torch.full((len(means), 1), float(step))
    state.pruned = torch.cat([state.pruned, torch.cat([means, at], dim=1)])
    state.splats = prune(state.splats, state.adam, removed)
    state.record = state.record.keep(torch.nonzero(~removed)[:, 0])
