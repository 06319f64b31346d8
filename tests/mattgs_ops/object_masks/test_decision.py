"""Every way in which votes and maps can be weighed against each other."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.masks import SoftMap
from mattgs_ops.object_masks.corrected_maps import averaged
from mattgs_ops.object_masks.decision import Decision, decide, half_meet_best
from mattgs_ops.object_masks.map_scores import MOST_ATTACHED, MOST_OFF_EDGES, ViewMaps
from mattgs_ops.object_masks.silhouettes import Silhouettes, iou, predict
from mattgs_ops.object_masks.splats.ground_plane import Plane
from mattgs_ops.object_masks.splats.labels import Place
from mattgs_ops.object_masks.splats.votes import LEVELS, VotedMaps
from tests.mattgs_ops.object_masks.ball import CENTRE, HEIGHT, RADIUS, VIEWS, WIDTH, orbit, truth

CAMERAS = orbit()
TRUTHS = [truth(camera) for camera in CAMERAS]
NAMES = [str(index) for index in range(VIEWS)]
PLACE = Place(CENTRE, RADIUS, None)
NO_OUTLINES = Silhouettes([soft * 0 for soft in TRUTHS], [0.0] * VIEWS, 1.0)


def photos() -> list[np.ndarray]:
    """Make white balls before black cloth."""
    return [np.repeat((t * 220).astype(np.uint8)[..., None], 3, axis=2) for t in TRUTHS]


def grown(soft: SoftMap, pixels: int) -> SoftMap:
    side = 2 * pixels + 1
    return np.asarray(cv2.dilate(soft, np.ones((side, side), np.uint8)), dtype=np.float32)


def votes(
    own: list[SoftMap],
    sure: list[SoftMap],
    whole: list[SoftMap] | None = None,
    clear: list[SoftMap] | None = None,
) -> VotedMaps:
    """Make votes whose prediction of each view is what they all say."""
    met = [iou(a >= 0.5, b >= 0.5) for a, b in zip(own, sure, strict=True)]
    return VotedMaps(sure, met, met, 0.25, sure, clear or sure, whole or sure, PLACE)


def views_of(
    pictures: list[np.ndarray],
    own: list[SoftMap],
    outlines: Silhouettes,
    trained: list[bool] | None = None,
    *,
    plain: bool = False,
) -> ViewMaps:
    return ViewMaps.of(NAMES, pictures, own, outlines, CAMERAS, trained, plain_ground=plain)


def decided(own: list[SoftMap], sure: list[SoftMap]) -> tuple[Decision, list[SoftMap]]:
    outlines = predict(CAMERAS, own)
    assert outlines is not None
    return decide(views_of(photos(), own, outlines), votes(own, sure))


def test_votes_make_the_masks_where_maps_leak_each_elsewhere() -> None:
    own = [t.copy() for t in TRUTHS]
    for index, soft in enumerate(own):  # another leak in each
        soft[40:, 10 * index % 80 : 10 * index % 80 + 16] = 1
    found, maps = decided(own, TRUTHS)
    assert found.masks == "votes"
    assert found.confirmed["votes"] > found.confirmed["maps"]
    assert all(np.array_equal(a, b) for a, b in zip(maps, TRUTHS, strict=True))
    assert {view.masks for view in found.views} == {"votes"}


def test_right_maps_survive_votes_that_fill_the_frame() -> None:
    full = [np.ones_like(t) for t in TRUTHS]
    found, maps = decided(TRUTHS, full)
    assert found.masks == "maps"
    assert "surely less than silhouettes" in found.reason
    scores = [iou(a >= 0.5, b > 0) for a, b in zip(maps, TRUTHS, strict=True)]
    assert min(scores) > 0.97


def test_votes_whose_outlines_run_through_even_ground_are_not_used() -> None:
    # they meet the maps as well as silhouettes do, but lie on black cloth
    away = [grown(t, 4) for t in TRUTHS]
    met = Silhouettes(away, [iou(a > 0, b > 0) for a, b in zip(away, TRUTHS, strict=True)], 1.0)
    found, _ = decide(views_of(photos(), TRUTHS, met), votes(TRUTHS, away))
    assert found.masks == "maps"
    assert found.votes == found.silhouettes
    assert found.confirmed["votes"] < found.confirmed["maps"]


@pytest.mark.parametrize("plain", [False, True])
def test_on_plain_ground_votes_must_lie_on_edges_as_much_as_maps(plain: bool) -> None:
    """Votes meet the maps better than silhouettes do, but run beside the photos' edges."""
    beside = [t.copy() for t in TRUTHS]
    for soft, camera in zip(beside, CAMERAS, strict=True):
        column, row = camera.project(CENTRE[None])[0][0].astype(int)
        soft[row - 3 : row + 3, column : column + 22] = 1
    views = views_of(photos(), TRUTHS, NO_OUTLINES, plain=plain)
    found, maps = decide(views, votes(TRUTHS, beside))
    assert found.masks == ("maps" if plain else "votes")
    assert ("on plain ground" in found.reason) is plain
    assert (iou(maps[0] >= 0.5, TRUTHS[0] >= 0.5) > 0.97) is plain


@pytest.mark.parametrize(("mended", "masks"), [(False, "votes"), (True, "maps")])
def test_on_plain_ground_maps_whose_outlines_lie_on_edges_need_no_votes(
    mended: bool, masks: str
) -> None:
    """Votes that are as right as can be replace maps that leak onto the ground, and no others."""
    own = [t.copy() for t in TRUTHS]
    for soft in own if not mended else []:
        soft[60:66, 4:40] = 1
    found, _ = decide(views_of(photos(), own, NO_OUTLINES, plain=True), votes(own, TRUTHS))
    assert found.masks == masks
    assert ("nothing to mend" in found.reason) is mended


@pytest.mark.parametrize("edges", [True, False])
def test_votes_that_are_surely_worse_by_edges_and_silhouettes_change_no_map(edges: bool) -> None:
    """Votes meet the maps better than silhouettes do, and take a slice of the ball away.

    The slice runs through even white, or photos show it as an edge: then the maps are the leak.
    """
    slices = [np.ones_like(t) for t in TRUTHS]
    for index, (soft, camera) in enumerate(zip(slices, CAMERAS, strict=True)):
        row = int(camera.project(CENTRE[None])[0][0][1])
        soft[row + 2 + index % 3 :] = 0
    cut = [t * part for t, part in zip(TRUTHS, slices, strict=True)]
    pictures = [(cut[k] * 220) for k in range(VIEWS)] if edges else [t * 220 for t in TRUTHS]
    shown = [np.repeat(p.astype(np.uint8)[..., None], 3, axis=2) for p in pictures]
    met = Silhouettes(TRUTHS, [0.3] * VIEWS, 1.0)
    found, maps = decide(views_of(shown, TRUTHS, met), votes(TRUTHS, cut))
    assert found.masks == ("votes" if edges else "maps")
    assert ("surely prefer the maps" in found.reason) is not edges
    assert np.array_equal(maps[0] >= 0.5, (cut if edges else TRUTHS)[0] >= 0.5)


def test_half_meet_best_is_the_largest_level_that_is_tried() -> None:
    assert [level for level in LEVELS if half_meet_best(level)] == [max(LEVELS)]


@pytest.mark.parametrize(
    ("level", "cut", "masks"),
    [(0.375, False, "votes"), (0.5, False, "maps"), (0.5, True, "votes")],
)
def test_where_half_of_the_votes_meet_maps_best_what_is_delivered_must_meet_them(
    level: float, cut: bool, masks: str
) -> None:
    """A quarter of the votes is for a plate under the ball, whose rim is an edge of the photo.

    Where ground was cut away, maps may take along what was cut: masks need not meet them.
    """
    plates = [grown(t, 10) for t in TRUTHS]
    shades = [110 * plate + 110 * ball for plate, ball in zip(plates, TRUTHS, strict=True)]
    pictures = [np.repeat(shade.astype(np.uint8)[..., None], 3, axis=2) for shade in shades]
    met = Silhouettes(TRUTHS, [0.9] * VIEWS, 1.0)
    place = replace(PLACE, ground=Plane(np.array([0.0, 0.0, 1.0]), 0.0, 0.5) if cut else None)
    split = replace(votes(TRUTHS, plates), level=level, agreement=[0.95] * VIEWS, place=place)
    found, maps = decide(views_of(pictures, TRUTHS, met), split)
    assert found.masks == masks
    assert (iou(maps[0] >= 0.5, TRUTHS[0] >= 0.5) > 0.9) is (masks == "maps")


@pytest.mark.parametrize(("pixels", "kept"), [(0, True), (12, False)])
def test_attached_parts_join_where_they_are_few(pixels: int, kept: bool) -> None:
    mast = [t.copy() for t in TRUTHS]
    for soft, camera in zip(mast, CAMERAS, strict=True):
        top = CENTRE + np.array([0, 0, RADIUS])
        column, row = camera.project(top[None])[0][0].astype(int)
        soft[max(0, row - 6) : row, column - 2 : column + 2] = 1
    whole = [grown(soft, pixels) if pixels else soft for soft in mast]
    shown = [np.repeat((m * 220).astype(np.uint8)[..., None], 3, axis=2) for m in mast]
    found, maps = decide(views_of(shown, TRUTHS, NO_OUTLINES), votes(TRUTHS, TRUTHS, whole))
    assert found.masks == "votes"
    assert found.attached_kept is kept
    assert np.array_equal(maps[0], whole[0] if kept else TRUTHS[0])


@pytest.mark.parametrize("shown", [False, True])
def test_parts_that_are_surely_worse_by_edges_and_maps_do_not_join(shown: bool) -> None:
    """A part beside the ball that no map shows; photos have an edge around it, or even cloth."""
    whole = [t.copy() for t in TRUTHS]
    for index, (soft, camera) in enumerate(zip(whole, CAMERAS, strict=True)):
        column, row = camera.project(CENTRE[None])[0][0].astype(int)
        # as wide as the ball's radius, a little higher in some views than in others
        soft[row - 5 : row + 4 + index % 3, column : column + 24] = 1
    drawn = whole if shown else TRUTHS
    pictures = [np.repeat((m * 220).astype(np.uint8)[..., None], 3, axis=2) for m in drawn]
    found, maps = decide(views_of(pictures, TRUTHS, NO_OUTLINES), votes(TRUTHS, TRUTHS, whole))
    assert found.confirmed["attached"] > found.confirmed["votes"] - MOST_OFF_EDGES
    assert found.attached < MOST_ATTACHED
    assert found.attached_kept is shown
    assert np.array_equal(maps[0], whole[0] if shown else TRUTHS[0])


@pytest.mark.parametrize("alike", [True, False])
def test_many_attached_parts_join_where_they_have_the_objects_colours(alike: bool) -> None:
    """Votes find the ball's middle alone; the rest has its colour, or the ground's."""
    core = [cv2.erode(t, np.ones((9, 9), np.uint8)) for t in TRUTHS]
    rim = np.array([40, 90, 160] if alike else [120, 120, 120])
    pictures = []
    for middle, whole in zip(core, TRUTHS, strict=True):
        photo = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
        photo[whole > 0] = rim
        cv2.drawContours(photo, cv2.findContours(whole.astype(np.uint8), 0, 2)[0], -1, (0, 0, 0))
        photo[middle > 0] = [40, 90, 160]
        pictures.append(photo)
    views = views_of(pictures, core, NO_OUTLINES)
    found, maps = decide(views, votes(core, core, TRUTHS))
    assert found.attached > MOST_ATTACHED
    assert found.alike is not None
    assert (found.alike > 0.5) is alike
    assert found.attached_kept is alike
    assert np.array_equal(maps[0], TRUTHS[0] if alike else core[0])
    clear = [cv2.erode(t, np.ones((7, 7), np.uint8)) for t in TRUTHS]
    found, maps = decide(views, votes(core, core, TRUTHS, clear))
    assert (found.attached_kept, found.clear_alone) == (True, not alike)
    assert np.array_equal(maps[0], TRUTHS[0] if alike else clear[0])


@pytest.mark.parametrize("met", [True, False])
def test_one_view_whose_voted_outline_misses_edges_keeps_a_better_map(met: bool) -> None:
    sure = [t.copy() for t in TRUTHS]
    sure[5] = grown(TRUTHS[5], 8)
    outlines = [soft * (index == 5 and met) for index, soft in enumerate(TRUTHS)]
    low = Silhouettes([o.astype(np.float32) for o in outlines], [0.0] * VIEWS, 1.0)
    found, maps = decide(views_of(photos(), TRUTHS, low), votes(TRUTHS, sure))
    assert found.masks == "votes"
    assert [view.name for view in found.views if view.masks == "maps"] == (["5"] if met else [])
    assert np.array_equal(maps[5], sure[5]) is not met


@pytest.mark.parametrize("trained", [True, False])
def test_a_held_out_view_that_splats_show_worse_than_all_others_keeps_its_map(
    trained: bool,
) -> None:
    """Floaters hide half of the ball from one camera; the photo has edges everywhere."""
    sure = [grown(t, 1) for t in TRUTHS]
    sure[5] = TRUTHS[5] * (np.arange(WIDTH) < WIDTH // 2)
    speckled = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    met = Silhouettes(TRUTHS, [0.8] * VIEWS, 1.0)
    use = [index != 5 or trained for index in range(VIEWS)]
    views = views_of([speckled] * VIEWS, TRUTHS, met, use)
    found, maps = decide(views, votes(TRUTHS, sure))
    assert found.masks == "votes"
    assert [view.name for view in found.views if view.masks == "maps"] == ([] if trained else ["5"])
    assert (iou(maps[5] >= 0.5, TRUTHS[5] >= 0.5) > 0.9) is not trained


def test_a_held_out_map_that_contradicts_silhouettes_is_replaced_by_votes() -> None:
    own = [t.copy() for t in TRUTHS]
    own[5] = np.roll(TRUTHS[5], WIDTH // 3, axis=1)
    met = Silhouettes(TRUTHS, [0.8] * VIEWS, 1.0)
    use = [index != 5 for index in range(VIEWS)]
    found, maps = decide(views_of(photos(), own, met, use), votes(TRUTHS, TRUTHS))
    assert iou(own[5] >= 0.5, TRUTHS[5] >= 0.5) < 0.5
    assert found.views[5].masks == "votes"
    assert np.array_equal(maps[5], TRUTHS[5])


@pytest.mark.parametrize("plain", [False, True])
def test_maps_that_make_the_masks_are_averaged_with_votes_along_outlines(plain: bool) -> None:
    """Votes miss a pixel all around; on plain ground nothing but they corrects the map."""
    smaller = [1 - grown(1 - t, 1) for t in TRUTHS]
    own = [grown(t, 1) for t in TRUTHS]
    own[2][4:24, 4:24] = 1  # a leak, outside the other silhouettes and the votes
    sure = Silhouettes([t.copy() for t in TRUTHS], [0.95] * VIEWS, 1.0)
    views = views_of(photos(), own, sure, plain=plain)
    found, maps = decide(views, replace(votes(own, smaller), agreement=[0.5] * VIEWS))
    assert (found.masks, found.own_kept) == ("maps", False)
    met = float(np.mean([iou(a > 0, b > 0) for a, b in zip(own, smaller, strict=True)]))
    shares = [found.confirmed["maps"], found.confirmed["votes"]]
    both = averaged(own, smaller, 0.95 * shares[0], met * shares[1])
    rim = (own[0] > 0) & (smaller[0] == 0)
    assert float(np.isclose(maps[0][rim], both[0][rim]).mean()) > 0.8
    assert 0.5 < float(both[0][rim].mean()) < 0.9
    assert (maps[2][8:20, 8:20] >= 0.5).all() == plain


def test_leaks_outside_the_other_silhouettes_are_taken_out() -> None:
    own = [t.copy() for t in TRUTHS]
    own[2][4:24, 4:24] = 1
    full = [np.ones_like(t) for t in TRUTHS]
    found, maps = decided(own, full)
    assert (found.masks, bool((maps[2][8:20, 8:20] < 0.5).all())) == ("maps", True)


def test_without_votes_maps_are_corrected_by_silhouettes() -> None:
    own = [t.copy() for t in TRUTHS]
    own[2][4:24, 4:24] = 1
    outlines = predict(CAMERAS, own)
    assert outlines is not None
    found, maps = decide(views_of(photos(), own, outlines), None)
    assert (found.masks, found.votes, found.alike) == ("maps", None, None)
    assert (found.attached, found.attached_kept, found.own_kept) == (0, False, False)
    assert (maps[2][8:20, 8:20] < 0.5).all()
    assert maps[0].shape == (HEIGHT, WIDTH)
