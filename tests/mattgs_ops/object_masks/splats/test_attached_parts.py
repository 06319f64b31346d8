"""Parts that touch the object join it; parts that stand on the ground beside it do not."""

import numpy as np
import torch

from mattgs_ops.object_masks.splats.attached_parts import (
    TOUCH,
    Touches,
    attached,
    grown,
    spreads,
    touching,
    without_stranded,
)
from mattgs_ops.splat.gaussians import Splats
from tests.reference import touching as slow

STEP = 0.1  # between the splats of a thing


def splats_at(means: np.ndarray, scales: np.ndarray | float = 0.03) -> Splats:
    count = len(means)
    scales = np.broadcast_to(scales, (count, 3))
    rng = np.random.default_rng(5)
    return Splats(
        means=torch.tensor(means, dtype=torch.float32),
        log_scales=torch.tensor(np.log(scales), dtype=torch.float32),
        quaternions=torch.tensor(rng.normal(size=(count, 4)), dtype=torch.float32),
        opacity_logits=torch.full((count,), 3.0),
        sh_dc=torch.zeros(count, 3),
        sh_rest=torch.zeros(count, 15, 3),
    )


def block(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    """Fill a thing from ``low`` to ``high`` with splats that touch their neighbours."""
    sides = [np.arange(a, b + STEP / 2, STEP) for a, b in zip(low, high, strict=True)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*sides)], axis=1)


def test_touches_and_parts_are_those_of_every_pair_looked_at() -> None:
    rng = np.random.default_rng(0)
    means = rng.uniform(-1, 1, (60, 3))
    splats = splats_at(means, rng.uniform(0.02, 0.2, (60, 3)))
    means = splats.means.numpy().astype(np.float64)
    found = touching(means, spreads(splats), neighbours=len(means))
    ends = zip(found.first.tolist(), found.second.tolist(), strict=True)
    pairs = {(min(pair), max(pair)) for pair in ends}
    wanted = slow.touch(means, spreads(splats), TOUCH)
    assert 20 < len(wanted) < 1500
    assert pairs == wanted
    among = rng.random(60) < 0.6
    numbers = found.parts(among)
    groups = {frozenset(np.flatnonzero(among & (numbers == n)).tolist()) for n in set(numbers)}
    assert groups - {frozenset()} == slow.parts(60, wanted, set(np.flatnonzero(among).tolist()))


def test_a_ball_is_as_wide_as_its_deviation_and_a_needle_only_along_itself() -> None:
    needle = splats_at(np.zeros((1, 3)), np.array([[0.5, 0.01, 0.01]]))
    spread = spreads(needle)[0]
    np.testing.assert_allclose(np.linalg.svd(spread)[1], [0.5, 0.01, 0.01], rtol=1e-5)


def scene() -> dict[str, np.ndarray]:
    """Make a body, a thin mast with a head on it, a box on the ground that leans on the body."""
    return {
        "body": block((-0.5, -0.5, 0.2), (0.5, 0.5, 0.6)),
        "mast": block((0.0, 0.0, 0.7), (0.0, 0.0, 1.0)),
        "head": block((-0.2, -0.1, 1.1), (0.2, 0.1, 1.3)),
        "box": block((0.6, -0.2, 0.1), (0.9, 0.2, 0.3)),
        "ground": block((-2.0, -2.0, 0.0), (2.0, 2.0, 0.0)),
        "speck": block((0.0, 1.6, 0.5), (0.1, 1.8, 0.6)),
    }


def belonging(
    things: dict[str, np.ndarray],
    sure: set[str],
    faint: set[str],
    radius: float = 0.9,
    *,
    clear: bool = False,
) -> dict[str, float]:
    """Return the share of each thing that is the object's, with all parts or with clear ones."""
    means = np.concatenate(list(things.values()))
    names = np.repeat(list(things), [len(points) for points in things.values()])
    distances = np.linalg.norm(means - [0, 0, 0.5], axis=1) / radius
    solid = ~np.isin(names, list(faint))
    certain = np.isin(names, list(sure))
    both = attached(splats_at(means), certain, solid, means[:, 2] > 0.05, distances)
    found = both.clear if clear else both.whole
    return {name: float(found[names == name].mean()) for name in things}


def test_a_head_joins_by_its_mast_a_box_on_the_ground_does_not() -> None:
    found = belonging(scene(), sure={"body", "mast", "speck"}, faint=set())
    assert found == {"body": 1, "mast": 1, "head": 1, "box": 0, "ground": 0, "speck": 0}


def test_a_part_that_touches_the_ground_a_little_joins_and_is_not_clear() -> None:
    things = scene()
    things["skirt"] = block((-0.5, -0.7, 0.2), (0.5, -0.6, 0.6))  # along the body's whole side …
    things["hem"] = block(
        (0.0, -0.7, 0.1), (0.0, -0.7, 0.1)
    )  # … and down to the ground at one spot
    for clear, skirt in ((False, 1), (True, 0)):
        found = belonging(things, sure={"body", "mast"}, faint=set(), clear=clear)
        assert (found["head"], found["skirt"], found["box"]) == (1, skirt, 0)


def test_a_mast_that_no_view_is_sure_of_joins_with_its_head() -> None:
    found = belonging(scene(), sure={"body"}, faint=set())
    assert (found["mast"], found["head"], found["box"]) == (1, 1, 0)


def test_a_head_of_which_a_part_is_sure_joins_by_a_mast_that_is_not() -> None:
    """What is sure of it lies outside the object's radius and touches nothing else that is."""
    things = scene()
    del things["head"]
    things["face"] = block((-0.2, -0.1, 1.1), (0.2, -0.1, 1.3))
    things["back"] = block((-0.2, 0.0, 1.1), (0.2, 0.1, 1.3))
    found = belonging(things, sure={"body", "face", "speck"}, faint=set(), radius=0.5)
    assert (found["face"], found["back"], found["mast"], found["speck"]) == (1, 1, 1, 0)


def test_a_head_without_a_mast_stays_where_it_is() -> None:
    things = scene()
    del things["mast"]
    assert belonging(things, sure={"body"}, faint=set())["head"] == 0


def test_faint_splats_keep_their_votes_or_join_with_the_nearest_solid_one() -> None:
    things = scene()
    things["veil"] = things["head"] + [0.02, 0.0, 0.0]  # about the head, which joins
    things["haze"] = things["box"] + [0.02, 0.0, 0.0]  # about the box, which does not
    things["fringe"] = things["body"] + [0.02, 0.0, 0.0]
    faint = {"veil", "haze", "fringe"}
    found = belonging(things, {"body", "mast"}, faint)
    assert (found["veil"], found["haze"], found["fringe"]) == (1, 0, 0)
    found = belonging(things, {"body", "haze", "fringe"}, faint)
    assert (found["haze"], found["fringe"]) == (1, 1)


def test_pieces_of_the_core_within_the_radius_stay_and_stranded_ones_go() -> None:
    touches = Touches(np.array([0, 1, 3]), np.array([1, 2, 4]))
    sure = np.ones(6, dtype=bool)
    distances = np.array([0.1, 0.2, 0.3, 1.5, 1.6, 0.9])
    found = grown(touches, sure, sure, distances)
    assert not found.clear.any()
    assert found.core.tolist() == [True, True, True, False, False, True]
    assert not found.joined.any()


def test_nothing_sure_means_nothing_belongs() -> None:
    found = belonging(scene(), sure=set(), faint=set())
    assert set(found.values()) == {0.0}


def test_without_its_ground_cut_an_object_loses_other_things_and_gains_nothing() -> None:
    things = scene()
    means = np.concatenate(list(things.values()))
    names = np.repeat(list(things), [len(points) for points in things.values()])
    distances = np.linalg.norm(means - [0, 0, 0.5], axis=1) / 0.9
    certain = np.isin(names, ["body", "mast", "speck"]) | (
        (names == "ground") & (np.abs(means[:, :2]).max(axis=1) < 0.5)
    )
    found = without_stranded(splats_at(means), certain, np.ones(len(means), bool), distances)
    assert np.array_equal(found, certain & (names != "speck"))
