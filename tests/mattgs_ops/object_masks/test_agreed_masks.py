"""What the delivered masks are cut by: the outline's network, called as it was trained."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.masks import Mask, SoftMap
from mattgs_ops.object_masks import agreed_masks
from mattgs_ops.object_masks.cross_view import agree
from mattgs_ops.object_masks.doubts import of_masks, of_poses
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.segment.outline.refine import OutlineRefiner
from tests.mattgs_ops.object_masks.ball import HEIGHT, WIDTH, orbit, truth
from tests.mattgs_ops.object_masks.contradictions.test_shared_points import write_key_points
from tests.mattgs_ops.object_masks.test_cross_view import solved

RED = (0, 0, 200)  # as OpenCV writes it


class Watching(OutlineRefiner):
    """Notes which photos it is called with, and how; changes nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple[str, tuple[int, ...]]] = []

    def refine(self, photo: NDArray[np.uint8], soft: SoftMap, mask: Mask) -> Mask:
        assert soft.shape == mask.shape
        self.calls.append(("near", tuple(photo[0, 0])))
        return mask

    def mend(self, photo: NDArray[np.uint8], soft: SoftMap) -> SoftMap:
        self.calls.append(("afar", tuple(photo[0, 0])))
        return soft


@pytest.mark.parametrize("plain", [False, True])
def test_the_network_sees_red_photos_as_red_and_from_afar_on_plain_ground(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plain: bool
) -> None:
    maps = [truth(camera) for camera in orbit()]
    photos = [np.full((HEIGHT, WIDTH, 3), RED, np.uint8) for _ in maps]
    scene, capture = solved(tmp_path, "u2net", maps, photos)
    watching = Watching()
    monkeypatch.setattr(agreed_masks, "OutlineRefiner", lambda: watching)
    report = MaskReport.load(tmp_path / "masks.json")
    agreed = {view.name: soft for view, soft in zip(scene.views, maps, strict=True)}
    agreed_masks.write(scene, capture, tmp_path, report, agreed, {}, plain_ground=plain, threads=1)
    looks = ["afar", "near"] if plain else ["near"]
    assert watching.calls == [(look, RED[::-1]) for _ in scene.views for look in looks]


def test_masks_are_scored_by_the_truth_without_the_lens_s_distortion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(agreed_masks, "OutlineRefiner", Watching)
    maps = [truth(camera) for camera in orbit()]
    photos = [np.full((HEIGHT, WIDTH, 3), RED, np.uint8) for _ in maps]
    scene, capture = solved(tmp_path, "u2net", maps, photos)
    views = []
    for view in scene.views:
        assert view.mask is not None
        true = tmp_path / f"true-{view.name}.png"
        true.write_bytes(view.mask.read_bytes())
        views.append(replace(view, coverage=true))
    distorted = [replace(view, mask=view.photo) for view in capture.views]  # all else than true
    scene = replace(scene, views=tuple(views))
    capture = replace(capture, masks_are="truth", views=tuple(distorted))
    report = MaskReport.load(tmp_path / "masks.json")
    agreed = {view.name: soft for view, soft in zip(scene.views, maps, strict=True)}
    agreed_masks.write(scene, capture, tmp_path, report, agreed, {}, plain_ground=False, threads=1)
    assert MaskReport.load(tmp_path / "masks.json").means()["iou"] > 0.95


@pytest.mark.parametrize(("wrong", "share"), [((), 1), ((1,), 10 / 20), ((1, 3), 7 / 23)])
def test_masks_that_came_along_are_in_doubt_where_they_contradict_each_other(
    tmp_path: Path, wrong: tuple[int, ...], share: float
) -> None:
    """All photos show one row of points, and each mask holds its left half, or wrongly its right.

    Of 15 pairs of photos some agree on 40 points; the others hold 80, and none together. All are
    taken from one place, so that outlines predict nothing.
    """
    maps = [np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(6)]
    for index, soft in enumerate(maps):
        first = 40 if index in wrong else 0
        soft[20:60, first : first + 40] = 1
    scene, capture = solved(tmp_path / "in", "given", maps, cameras=[orbit()[0]] * 6)
    names = [view.name for view in scene.views]
    same = np.stack([np.arange(80)] * 2, axis=1)
    matches = dict.fromkeys(combinations(range(6), 2), same)
    write_key_points(tmp_path / "in", names, [np.arange(80) + 0.5] * 6, matches, row=30.5)
    done = agree(scene, capture, tmp_path / "out")
    report = MaskReport.load(tmp_path / "out" / "masks.json")
    shared = done.extra["agreement"]["shared_points"]
    assert shared["share"] == pytest.approx(share)
    assert sorted(shared["contradict"]) == [names[index] for index in wrong]
    flags = {row.name: row.flags for row in report.flagged}
    assert flags == {names[index]: ("contradicts",) for index in wrong}
    told = [doubt.text for doubt in of_masks(report, done.extra) if doubt.serious]
    assert ["contradict each other" in text for text in told] == [True] * (share < 0.5)
    for path in (tmp_path / "in" / "masks").iterdir():
        assert (tmp_path / "out" / "masks" / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("source", ["given", "none"])
def test_masks_that_outlines_contradict_are_flagged_unless_they_cover_whole_photos(
    tmp_path: Path, source: str
) -> None:
    """Of a ball beside the middle, one mask shows it on the wrong side."""
    maps = [truth(camera) for camera in orbit()]
    maps[3] = np.roll(maps[3], WIDTH // 3, axis=1)
    scene, capture = solved(tmp_path / "in", source, maps)
    done = agree(scene, capture, tmp_path / "out")
    report = MaskReport.load(tmp_path / "out" / "masks.json")
    flags = {row.name: row.flags for row in report.flagged}
    assert flags == ({"3.jpg": ("contradicts",)} if source == "given" else {})
    assert len(of_poses(done.extra)) == len(flags)
