"""Relocation, growth and noise against the paper's equations, one splat at a time."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from mattgs_ops.config import TrainConfig
from mattgs_ops.method import METHODS, McmcConfig, MethodConfig
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.optimise import FIELDS, Adam
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.strategies.mcmc import (
    MOST_COPIES,
    McmcStrategy,
    add,
    relocate,
    shake,
    shared,
)

DEAD = 0.005
MakeSplats = Callable[[int, int], Splats]


def slow_shared(opacity: float, copies: int) -> tuple[float, float]:
    """Eq. 9 of Kheradmand et al. 2024 as it stands: opacity, and factor of the scales."""
    each = 1 - (1 - opacity) ** (1 / copies)
    total = 0.0
    for i in range(1, copies + 1):
        for k in range(i):
            total += math.comb(i - 1, k) * (-1) ** k * each ** (k + 1) / math.sqrt(k + 1)
    return each, opacity / total


@pytest.mark.parametrize("copies", [1, 2, 3, 7, 20, 51])
def test_shared_opacity_and_scale_are_equation_9(copies: int) -> None:
    opacities = np.array([0.01, 0.2, 0.5, 0.9, 0.999])
    each, factor = shared(opacities, np.full(5, copies))
    for n, opacity in enumerate(opacities):
        expected = slow_shared(float(opacity), copies)
        assert each[n] == pytest.approx(expected[0], rel=1e-9)
        assert factor[n] == pytest.approx(expected[1], rel=1e-9)
    if copies == 1:
        np.testing.assert_allclose(each, opacities)
        np.testing.assert_allclose(factor, 1)


def test_more_copies_than_the_table_count_as_its_last() -> None:
    one, many = (shared(np.array([0.7]), np.array([n])) for n in (MOST_COPIES, 400))
    np.testing.assert_array_equal(one, many)


@pytest.mark.parametrize("copies", [2, 5, 12])
def test_copies_look_as_the_one_did(copies: int) -> None:
    """Along a line through the middle they add up to the one's total, and cover as much there."""
    opacity = 0.8
    each, factor = shared(np.array([opacity]), np.array([copies]))
    x = np.linspace(-12, 12, 20_001)
    before = opacity * np.exp(-(x**2) / 2)
    after = 1 - (1 - each[0] * np.exp(-((x / factor[0]) ** 2) / 2)) ** copies
    assert after.max() == pytest.approx(before.max(), rel=1e-6)
    assert after.sum() == pytest.approx(before.sum(), rel=1e-6)


@pytest.fixture
def splats(make_splats: MakeSplats) -> Splats:
    """Eight splats of which two are dead."""
    made = make_splats(8, 0)
    opacity = torch.tensor([0.9, 0.004, 0.5, 0.1, 0.005, 0.7, 0.3, 0.6])
    made.opacity_logits[:] = torch.logit(opacity)
    return made


def with_moments(splats: Splats) -> Adam:
    adam = Adam(splats)
    for name in FIELDS:
        adam.first[name] += 1
        adam.second[name] += 2
    return adam


def copied(splats: Splats) -> Splats:
    return Splats(**{name: value.clone() for name, value in splats.items()})


def test_dead_splats_move_to_live_ones_and_share_with_them(splats: Splats) -> None:
    before, adam = copied(splats), with_moments(splats)
    assert relocate(splats, adam, DEAD, np.random.default_rng(3)) == 2
    assert bool((splats.opacity_logits > torch.logit(torch.tensor(DEAD))).all())
    weights = before.opacity_logits.double().sigmoid().numpy()
    alive = [n for n in range(8) if n not in (1, 4)]
    share = weights[alive] / weights[alive].sum()
    chosen = [alive[n] for n in np.random.default_rng(3).choice(6, size=2, p=share)]
    for dead, source in zip((1, 4), chosen, strict=True):
        each, factor = slow_shared(float(weights[source]), 1 + chosen.count(source))
        for place in (dead, source):
            assert float(splats.opacity_logits[place].sigmoid()) == pytest.approx(each, rel=1e-5)
            torch.testing.assert_close(
                splats.log_scales[place], before.log_scales[source] + math.log(factor)
            )
            for name in ("means", "quaternions", "sh_dc", "sh_rest"):
                assert torch.equal(getattr(splats, name)[place], getattr(before, name)[source])
        assert float(adam.first["means"][source].sum()) == 0
        assert float(adam.second["means"][dead].min()) == 2
    for other in set(alive) - set(chosen):
        for name in FIELDS:
            assert torch.equal(getattr(splats, name)[other], getattr(before, name)[other])
            assert float(adam.first[name][other].min()) == 1


def test_without_dead_ones_or_without_live_ones_nothing_moves(splats: Splats) -> None:
    for opacity in (0.5, 0.001):
        splats.opacity_logits[:] = math.log(opacity / (1 - opacity))
        before = copied(splats)
        assert relocate(splats, Adam(splats), DEAD, np.random.default_rng(0)) == 0
        assert torch.equal(before.opacity_logits, splats.opacity_logits)


def test_added_splats_stand_beside_opaque_ones(splats: Splats) -> None:
    adam = with_moments(splats)
    more = add(splats, adam, 400, DEAD, np.random.default_rng(5))
    assert len(more) == 408
    assert {len(adam.first[name]) for name in FIELDS} == {408}
    assert float(adam.second["sh_dc"][8:].abs().max()) == 0
    source = [int(torch.where((splats.means == m).all(1))[0][0]) for m in more.means[8:]]
    counts = np.bincount(source, minlength=8)
    weights = np.array([0.9, 0.004, 0.5, 0.1, 0.005, 0.7, 0.3, 0.6])
    expected = 400 * weights / weights.sum()
    assert np.all(np.abs(counts - expected) < 4 * np.sqrt(expected) + 1)  # four deviations
    assert add(splats, adam, 0, DEAD, np.random.default_rng(5)) is splats


def test_splats_that_let_nothing_through_are_shared_in_finite_numbers(splats: Splats) -> None:
    splats.opacity_logits[:] = 50.0  # opacity 1 to the bit
    more = add(splats, Adam(splats), 8, DEAD, np.random.default_rng(5))
    assert bool(torch.isfinite(more.opacity_logits).all())
    assert bool(torch.isfinite(more.log_scales).all())
    assert float(more.opacity_logits.sigmoid().min()) > 0.999


def test_noise_has_the_splats_shape_and_spares_opaque_ones(splats: Splats) -> None:
    before, strength = copied(splats), 3.0
    shake(splats, strength, np.random.default_rng(11))
    rng = np.random.default_rng(11)
    moved = 0
    for n in range(8):
        opacity = float(before.opacity_logits[n].double().sigmoid())
        if opacity > 0.25:
            assert torch.equal(splats.means[n], before.means[n])
            continue
        moved += 1
        w, x, y, z = before.quaternions[n].double().tolist()
        spread = (
            Rotation.from_quat([x, y, z, w]).as_matrix()
            * before.log_scales[n].double().exp().numpy()
        )
        factor = 1 / (1 + math.exp(-100 * ((1 - opacity) - 0.995)))
        noise = rng.standard_normal(3, dtype=np.float32)
        expected = spread @ spread.T @ noise * factor * strength
        found = (splats.means[n] - before.means[n]).double().numpy()
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
    assert moved == 3


def test_the_weights_are_gradients_of_the_penalty(splats: Splats) -> None:
    schedule = Schedule.of(TrainConfig(), 1000, 1.0, mcmc=True)
    strategy = McmcStrategy(McmcConfig(), TrainConfig(), schedule, 1.0)
    opacity = splats.opacity_logits.sigmoid().requires_grad_()
    scales = splats.log_scales.exp().requires_grad_()
    penalty = 0.01 * opacity.mean() + 0.01 * scales.mean()
    penalty.backward()
    assert strategy.penalty(splats) == pytest.approx(float(penalty.detach()), rel=1e-5)
    of_opacity, of_scale = strategy.penalties(8)
    assert opacity.grad is not None
    assert scales.grad is not None
    torch.testing.assert_close(opacity.grad, torch.full((8,), of_opacity))
    torch.testing.assert_close(scales.grad, torch.full((8, 3), of_scale))


def stepped(splats: Splats, step: int, most: int = 1000, noise: float = 0.0) -> TrainingState:
    """Return what a training of 1,000 steps has after ``step``; rates of positions are doubled."""
    config = TrainConfig().model_copy(update={"max_splats": most})
    schedule = Schedule.of(config, 1000, 1.0, mcmc=True)
    strategy = McmcStrategy(McmcConfig(noise=noise, growth=0.3), config, schedule, 2.0)
    state = TrainingState.start(splats, 0)
    unread: Any = None  # what the step observed and showed
    strategy.after_step(state, step, unread, unread)
    return state


@pytest.mark.parametrize(
    ("step", "most", "count", "counters"),
    [
        (100, 1000, 10, {"relocated": 2, "added": 2, "capped": 0}),  # 1.3 × 8, rounded down
        (100, 10, 10, {"relocated": 2, "added": 2, "capped": 1}),
        (100, 9, 9, {"relocated": 2, "added": 1, "capped": 1}),
        (100, 5, 8, {"relocated": 2, "added": 0, "capped": 1}),  # began with more
        (101, 1000, 8, {}),  # not due
    ],
)
def test_at_a_relocation_splats_grow_by_their_share_up_to_the_most(
    splats: Splats, step: int, most: int, count: int, counters: dict[str, int]
) -> None:
    state = stepped(splats, step, most)
    assert len(state.splats) == len(state.record.seen) == count
    assert state.counters == counters


def test_every_step_shakes_by_the_rate_of_positions(splats: Splats) -> None:
    before, noise = copied(splats), 1000.0
    still = stepped(copied(splats), 101).splats
    state = stepped(splats, 101, noise=noise)
    rate = Schedule.of(TrainConfig(), 1000, 1.0, mcmc=True).position_rate(101)
    shake(before, 2.0 * rate * noise, TrainingState.start(before, 0).streams["mcmc"])
    assert torch.equal(state.splats.means, before.means)
    assert not torch.equal(state.splats.means, still.means)


def test_the_published_schedule_and_short_ones() -> None:
    published = Schedule.of(TrainConfig(), 30_000, 1.0, mcmc=True)
    assert (published.densify_from, published.densify_until) == (500, 25_000)
    assert (published.densify_every, published.reset_every) == (100, 0)
    short = Schedule.of(TrainConfig(), 1000, 1.0, mcmc=True)
    due = [step for step in range(1, 1001) if short.densifies(step)]
    assert due[0] == 20
    assert due[-1] == 820
    assert set(np.diff(due)) == {20}
    assert not any(short.resets(step) for step in range(1, 1001))


def test_the_method_is_built_in_and_takes_no_pruning() -> None:
    assert METHODS["mcmc"].growth == "mcmc"
    with pytest.raises(
        ValueError, match=r"prune: expected 'none' with growth `mcmc`, found 'pixel'"
    ):
        MethodConfig(growth="mcmc", prune="pixel")
    with pytest.raises(ValueError, match="densify: expected 'signed'"):
        MethodConfig(growth="mcmc", densify="absolute")
