"""Cloning, splitting, pruning and resets, and that the optimiser's state follows."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from mattgs_ops.config import TrainConfig
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.densify import (
    Record,
    faint_or_huge,
    grow,
    logit,
    prune,
    reset_opacity,
    rotation_matrices,
)
from mattgs_ops.splat.training.optimise import FIELDS, Adam

EXTENT = 10.0  # splats above 0.1 are large, above 1 huge
MakeSplats = Callable[[int, int], Splats]


@pytest.fixture
def splats(make_splats: MakeSplats) -> Splats:
    """Six splats: the first three small, the others large."""
    made = make_splats(6, 0)
    made.log_scales[:3] = float(np.log(0.05))
    made.log_scales[3:] = float(np.log(0.5))
    return made


@pytest.fixture
def adam(splats: Splats) -> Adam:
    """Make moments that tell each splat apart."""
    made = Adam(splats)
    for name in FIELDS:
        shape = made.first[name].shape
        tag = torch.arange(1.0, 7).reshape(-1, *[1] * (len(shape) - 1))
        made.first[name] += tag
        made.second[name] += 10 * tag
    return made


def record(gradients: list[float]) -> Record:
    made = Record.empty(len(gradients))
    made.gradient += torch.tensor(gradients) * 4
    made.seen += 4
    return made


def grown_by(
    splats: Splats,
    adam: Adam,
    noticed: Record,
    config: TrainConfig | None = None,
    extent: float = EXTENT,
) -> Splats:
    config = config or TrainConfig()
    return grow(splats, adam, noticed.gradients(), config.densify_gradient, config, extent, rng())


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_high_gradients_clone_the_small_and_split_the_large(splats: Splats, adam: Adam) -> None:
    noticed = record([3e-4, 1e-4, 0, 1e-4, 5e-4, 0])
    grown = grown_by(splats, adam, noticed)
    # 1 cloned, 4 replaced by two: kept 0 1 2 3 5, then the clone of 0, then the halves of 4
    assert len(grown) == 8
    for name in FIELDS:
        before, after = getattr(splats, name), getattr(grown, name)
        assert torch.equal(after[:5], before[[0, 1, 2, 3, 5]])
        assert torch.equal(after[5], before[0])
        if name not in ("means", "log_scales"):
            assert torch.equal(after[6:], before[[4, 4]])
    torch.testing.assert_close(grown.log_scales[6:].exp(), splats.log_scales[[4, 4]].exp() / 1.6)
    assert not torch.equal(grown.means[6], grown.means[7])


def test_adams_moments_stay_with_the_old_and_are_zero_for_the_new(
    splats: Splats, adam: Adam
) -> None:
    adam.steps = 17
    noticed = record([3e-4, 0, 0, 0, 5e-4, 0])
    grown = grown_by(splats, adam, noticed)
    for name in FIELDS:
        tags = adam.first[name].reshape(len(grown), -1)[:, 0].tolist()
        assert tags == [1, 2, 3, 4, 6, 0, 0, 0]
        assert torch.equal(adam.second[name], 10 * adam.first[name])
    assert adam.steps == 17


def test_the_threshold_applies_to_the_mean_over_steps_that_saw_the_splat(
    splats: Splats, adam: Adam
) -> None:
    noticed = Record.empty(6)
    noticed.gradient += torch.tensor([6e-4, 6e-4, 0, 0, 0, 0])
    noticed.seen += torch.tensor([3.0, 4, 0, 0, 0, 0])  # means 2e-4 and 1.5e-4
    assert len(grown_by(splats, adam, noticed)) == 7


def test_contributions_are_blending_weights_per_step_that_saw_the_splat() -> None:
    noticed = record([0.0, 0.0, 0.0])
    noticed.seen[2] = 0
    noticed.weight += torch.tensor([8.0, 1.0, 0.0])
    assert noticed.contributions().tolist() == [2.0, 0.25, 0.0]


def test_halves_are_drawn_from_the_splats_own_density(make_splats: MakeSplats) -> None:
    one = make_splats(1, 0)
    one.means[0] = torch.tensor([1.0, -2, 3])
    one.log_scales[0] = torch.log(torch.tensor([1.0, 0.2, 0.5]))
    one.quaternions[0] = torch.tensor([0.3, -0.8, 0.5, 1.2])
    many = Splats(**{n: t.repeat(4000, *[1] * (t.ndim - 1)) for n, t in one.items()})
    grown = grown_by(many, Adam(many), record([1.0] * 4000), extent=1.0)
    assert len(grown) == 8000
    turn = Rotation.from_quat([-0.8, 0.5, 1.2, 0.3]).as_matrix()  # SciPy has w last
    expected = turn @ np.diag([1.0, 0.04, 0.25]) @ turn.T
    np.testing.assert_allclose(np.cov(grown.means.numpy().T), expected, atol=0.05)
    np.testing.assert_allclose(grown.means.numpy().mean(axis=0), [1, -2, 3], atol=0.05)


def test_no_more_splats_than_allowed_and_the_neediest_first(splats: Splats, adam: Adam) -> None:
    noticed = record([3e-4, 9e-4, 4e-4, 5e-4, 8e-4, 0])
    config = TrainConfig().model_copy(update={"max_splats": 8})
    grown = grown_by(splats, adam, noticed, config)
    assert len(grown) == 8
    assert torch.equal(grown.means[:5], splats.means[[0, 1, 2, 3, 5]]), "4 was split"
    assert torch.equal(grown.means[5], splats.means[1]), "1 was cloned"
    full = TrainConfig().model_copy(update={"max_splats": 5})
    assert len(grown_by(splats, Adam(splats), noticed, full)) == 6


def test_faint_splats_go_and_huge_ones_once_size_counts(splats: Splats) -> None:
    splats.opacity_logits[2] = logit(0.0049)
    splats.opacity_logits[1] = logit(0.0051)
    splats.log_scales[4, 1] = float(np.log(1.01))
    splats.log_scales[5, 1] = float(np.log(0.99))
    config = TrainConfig()
    early = faint_or_huge(splats, config, EXTENT, huge=False)
    late = faint_or_huge(splats, config, EXTENT, huge=True)
    assert early.tolist() == [False, False, True, False, False, False]
    assert late.tolist() == [False, False, True, False, True, False]


def test_pruning_takes_the_moments_along(splats: Splats, adam: Adam) -> None:
    left = prune(splats, adam, torch.tensor([True, False, False, True, False, False]))
    assert torch.equal(left.sh_rest, splats.sh_rest[[1, 2, 4, 5]])
    assert adam.second["opacity_logits"].tolist() == [20, 30, 50, 60]


def test_a_reset_lowers_opacities_and_forgets_their_moments(splats: Splats, adam: Adam) -> None:
    splats.opacity_logits[:] = torch.tensor([logit(o) for o in (0.9, 0.5, 0.02, 0.01, 0.006, 0.1)])
    reset_opacity(splats, adam)
    expected = torch.tensor([0.01, 0.01, 0.01, 0.01, 0.006, 0.01])
    torch.testing.assert_close(torch.sigmoid(splats.opacity_logits), expected)
    assert not adam.first["opacity_logits"].any()
    assert not adam.second["opacity_logits"].any()
    assert adam.first["means"].all()


def test_the_record_adds_ndc_norms_of_the_steps_that_saw_a_splat() -> None:
    noticed = Record.empty(3)
    noticed.observe(
        torch.tensor([[3e-6, 0], [0, 4e-6], [0, 0]]), torch.tensor([2.0, 1, 0]), 400, 200
    )
    noticed.observe(
        torch.tensor([[3e-6, 8e-6], [0, 0], [0, 0]]), torch.tensor([2.0, 0, 0]), 400, 200
    )
    # half a width or height of pixels is one NDC unit
    expected = torch.tensor([6e-4 + float(np.hypot(6e-4, 8e-4)), 4e-4, 0])
    torch.testing.assert_close(noticed.gradient, expected)
    assert noticed.seen.tolist() == [2, 1, 0]


def test_blend_scores_are_attention_per_weight() -> None:
    noticed = Record.empty(3)
    noticed.weight += torch.tensor([2.0, 0.5, 0])
    noticed.attention += torch.tensor([1.0, 0, 0])
    assert noticed.blend_scores().tolist() == [0.5, 0, 0]
    assert noticed.keep(torch.tensor([1, 0])).weight.tolist() == [0.5, 2]


def test_rotations_are_those_of_the_normalised_quaternions() -> None:
    drawn = np.random.default_rng(0).normal(size=(20, 4))
    expected = Rotation.from_quat(drawn[:, [1, 2, 3, 0]]).as_matrix()
    found = rotation_matrices(torch.from_numpy(drawn)).numpy()
    np.testing.assert_allclose(found, expected, atol=1e-12)
