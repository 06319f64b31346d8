"""Views vote without haze, unless what is faint is a part of the object."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mattgs_ops.object_masks.decision import decide
from mattgs_ops.object_masks.map_scores import ViewMaps
from mattgs_ops.object_masks.silhouettes import predict
from mattgs_ops.object_masks.vote_checks import Source
from mattgs_ops.object_masks.vote_variants import Outcome, VoteVariants
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_CONSTANT
from mattgs_ops.splat.rasterize import render
from tests.mattgs_ops.object_masks.ball import CENTRE, VIEWS, notched, orbit, truth
from tests.mattgs_ops.object_masks.splats.test_votes import BALL, scene_of_splats
from tests.mattgs_ops.object_masks.test_decision import votes

FAINT = 0.15  # opacity
BLACK = (0.0, 0.0, 0.0)


def joined(*sets: Splats) -> Splats:
    fields = [dict(one.items()) for one in sets]
    return Splats(**{name: torch.cat([one[name] for one in fields]) for name in fields[0]})


def chosen(splats: Splats, which: np.ndarray) -> Splats:
    index = torch.from_numpy(np.flatnonzero(which))
    return Splats(**{name: tensor[index].clone() for name, tensor in splats.items()})


def faint(splats: Splats) -> Splats:
    splats.opacity_logits[:] = float(np.log(FAINT / (1 - FAINT)))
    return splats


def variants_of_ten_views() -> VoteVariants:
    """Let ten views vote on a red ball on a speckled desk; their maps are right."""
    splats, cameras = scene_of_splats(), orbit()
    colours = np.random.default_rng(0).uniform(0.0, 0.9, (len(splats), 3))
    colours[:BALL] = [0.8, 0.1, 0.1]
    splats.sh_dc = torch.from_numpy(((colours - 0.5) / SH_CONSTANT).astype(np.float32))
    shown = [render(splats, camera, BLACK, sh_degree=0).image.clamp(0, 1) for camera in cameras]
    photos = [np.rint(one.numpy() * 255).astype(np.uint8) for one in shown]
    truths = [truth(camera) for camera in cameras]
    outlines = predict(cameras, truths)
    assert outlines is not None
    names = [f"{k}.jpg" for k in range(VIEWS)]
    none = np.zeros((0, 3))
    views = ViewMaps.of(names, photos, truths, outlines, cameras)
    return VoteVariants(views, cameras, cameras, none, 1)


def overlap(found: Outcome) -> float:
    """Return the votes' mean IoU with the maps; a pixel around the ball is a fifth of it."""
    return float(np.mean([view.with_parts or 0.0 for view in found.decision.views]))


def test_haze_before_the_object_neither_votes_nor_hides_it() -> None:
    variants = variants_of_ten_views()
    splats = scene_of_splats()
    veil = faint(chosen(splats, np.arange(len(splats)) >= BALL))
    away = np.random.default_rng(1).normal((0.95, 0.0, 0.1), 0.35, (len(veil), 3))
    veil.means[:] = torch.from_numpy((CENTRE + away).astype(np.float32))
    veil.log_scales[:] = float(np.log(0.2))
    found = variants.best(joined(splats, veil))
    assert not found.haze_votes
    assert overlap(found) > 0.8  # with haze 0.44


def test_faint_splats_that_are_the_object_count() -> None:
    """A short training leaves an even, dark part to many faint splats, one behind the other."""
    variants = variants_of_ten_views()
    splats = scene_of_splats()
    means = splats.means.numpy()
    cap = (np.arange(len(splats)) < BALL) & (means[:, 2] > 0.75)
    layers = [faint(chosen(splats, cap)) for _ in range(12)]
    found = variants.best(joined(chosen(splats, ~cap), *layers))
    assert found.haze_votes
    assert overlap(found) > 0.8  # without them 0.77


@pytest.mark.parametrize(("clear", "hazy"), [("maps", "votes"), ("votes", "maps")])
def test_votes_with_haze_are_preferred_where_those_without_do_not_make_the_masks(
    monkeypatch: pytest.MonkeyPatch, clear: Source, hazy: Source
) -> None:
    """Both are worth the same."""
    variants = variants_of_ten_views()
    splats = scene_of_splats()
    veiled = joined(splats, faint(chosen(splats, np.arange(len(splats)) >= BALL)))
    usual = variants.best(splats)

    def votes_on(_: VoteVariants, asked: Splats) -> Outcome:
        masks = hazy if len(asked) == len(veiled) else clear
        return replace(usual, decision=replace(usual.decision, masks=masks))

    monkeypatch.setattr(VoteVariants, "_votes_on", votes_on)
    found = variants.best(veiled)
    assert found.votes_used
    assert found.haze_votes is (hazy == "votes")


@pytest.mark.parametrize("cut", [True, False])
def test_the_best_votes_are_compared_with_the_maps_unless_ground_was_cut_away(
    monkeypatch: pytest.MonkeyPatch, cut: bool
) -> None:
    """Votes lack another part of the ball in each view; right maps predict each other better."""
    variants = variants_of_ten_views()
    truths = list(variants.views.own.maps)
    low = replace(variants.views, silhouettes=0.0, by_outline=[0.0] * VIEWS)
    variants, voted = replace(variants, views=low), votes(truths, notched(truths))
    decision, maps = decide(low, voted)
    assert decision.masks == "votes"
    usual = Outcome(decision, maps, voted, None, cut, half_needed=False)
    monkeypatch.setattr(VoteVariants, "_votes_on", lambda *_: usual)
    assert variants.best(scene_of_splats()).votes_used is cut
