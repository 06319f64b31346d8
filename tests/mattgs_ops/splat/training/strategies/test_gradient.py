"""A budgeted growth, and which splats go; thresholds are in test_densify and test_train."""

import itertools
from collections.abc import Callable

import numpy as np
import torch

from mattgs_ops.config import TrainConfig
from mattgs_ops.method import MethodConfig
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.densify import logit
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.strategies.gradient import GradientStrategy, budget_at

STEP = 700
MakeSplats = Callable[[int, int], Splats]


def strategy_of(method: MethodConfig) -> GradientStrategy:
    """Return the strategy of a method whose points have the attention of their x."""
    config = TrainConfig()
    schedule = Schedule.of(config, 1000, 1.0)

    def scores(points: np.ndarray) -> np.ndarray:
        return points[:, 0].astype(np.float32)

    return GradientStrategy(method, config, schedule, 1.0, "nobg", scores)


def state_of(splats: Splats) -> TrainingState:
    splats.means[:] = torch.arange(len(splats), dtype=torch.float32)[:, None] / 10
    return TrainingState.start(splats, 0)


def left(state: TrainingState) -> list[float]:
    """Return which splats are left, by their x in tenths."""
    return (state.splats.means[:, 0] * 10).round().tolist()


def test_splats_that_hardly_show_where_they_are_seen_are_idle(make_splats: MakeSplats) -> None:
    state = state_of(make_splats(4, 0))
    state.record.seen[:] = torch.tensor([0.0, 1.0, 1.0, 4.0])  # the first was seen by no view
    state.record.weight[:] = torch.tensor([0.0, 0.2, 0.4, 1.0])
    strategy_of(MethodConfig(prune_contribution=0.3))._prune_idle(state, STEP)
    assert left(state) == [0, 2]
    assert state.counters == {"removed_idle": 2}
    np.testing.assert_allclose(
        state.pruned, [[0.1, 0.1, 0.1, STEP], [0.3, 0.3, 0.3, STEP]], rtol=1e-6
    )
    assert state.record.seen.tolist() == [0, 1]


def test_splats_without_opacity_and_attention_are_unattended(make_splats: MakeSplats) -> None:
    state = state_of(make_splats(4, 0))
    state.splats.opacity_logits[:] = torch.tensor([logit(0.01), logit(0.5)] * 2)
    method = MethodConfig(prune="pixel", prune_opacity=0.1, prune_attention=0.15)
    strategy_of(method)._prune_unattended(state, STEP)
    assert left(state) == [1, 2, 3], "the third is faint and attended to, the second is opaque"
    # by the attention that was blended instead of that at the points
    state.record.weight[:] = 1.0
    state.record.attention[:] = torch.tensor([0.0, 0.1, 0.9])
    by_blending = method.model_copy(update={"prune": "blend"})
    strategy_of(by_blending)._prune_unattended(state, STEP)
    assert left(state) == [1, 3]


def test_a_budget_is_reached_by_the_last_densification() -> None:
    schedule = Schedule.of(TrainConfig(), 30_000, 1.0)
    due = [step for step in range(1, 30_001) if schedule.densifies(step)]
    counts = [budget_at(step, 1000, 9000, schedule) for step in due]
    assert counts[-1] == 9000
    assert all(a <= b for a, b in itertools.pairwise(counts))
    # a parabola: half way it has three quarters of what it adds
    middle = (schedule.densify_from + due[-1]) // 2
    assert budget_at(middle, 1000, 9000, schedule) == 7000
    assert budget_at(1, 1000, 9000, schedule) == 1000


def test_a_budget_below_the_start_adds_nothing() -> None:
    schedule = Schedule.of(TrainConfig(), 1000, 1.0)
    assert {budget_at(step, 500, 100, schedule) for step in (1, 300, 1000)} == {500}
