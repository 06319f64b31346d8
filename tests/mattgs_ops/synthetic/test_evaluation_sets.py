"""Evaluation sets: every object on every ground, views that follow from their number alone."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the `captures` extra is not installed")

from mattgs_ops.errors import InputError
from mattgs_ops.synthetic import cameras
from mattgs_ops.synthetic.evaluation_sets import (
    CHOOSING_SETS,
    JUDGING_SETS,
    NAMES,
    OBJECTS,
    SETS,
    WALK,
    EvaluationSet,
    render_sets,
    walk,
)
from mattgs_ops.synthetic.surroundings.grounds import GROUNDS

SMALL = {"width": 32, "height": 24, "samples": 1, "variant": "scalar_rgb"}


@pytest.fixture(scope="module")
def flash(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sets")
    render_sets(out, ["figurine-dark-flash"], views=12, **SMALL)  # type: ignore[arg-type]
    return out


def test_every_object_and_every_ground_is_in_some_set_and_no_set_is_there_twice() -> None:
    assert len(CHOOSING_SETS) == 28
    assert len(set(NAMES)) == len({tuple(one.seeds) for one in SETS}) == 34
    assert {one.thing for one in SETS} == set(OBJECTS)
    assert {one.ground for one in SETS} == set(GROUNDS)


def test_no_set_that_judges_was_chosen_by() -> None:
    assert not {one.name for one in JUDGING_SETS} & {one.name for one in CHOOSING_SETS}


@pytest.mark.parametrize("one", JUDGING_SETS, ids=lambda one: one.name)
def test_an_object_that_judges_stands_in_the_middle_of_its_photos(
    one: EvaluationSet, tmp_path: Path
) -> None:
    render_sets(tmp_path, [one.name], views=12, **SMALL)  # type: ignore[arg-type]
    for path in sorted((tmp_path / one.name / "masks").iterdir()):
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert mask is not None
        assert 0.05 < (mask >= 128).mean() < 0.7
        assert mask[:, 12:20].max() == 255


def test_a_walk_goes_around_and_any_quarter_of_it_does_too() -> None:
    poses, exposures = walk(SETS[0])
    eyes = np.array([pose[:3, 3] for pose in poses])
    around = np.degrees(np.unwrap(np.arctan2(eyes[:, 1], eyes[:, 0])))
    assert len(poses) == len(exposures) == WALK
    for step in (1, 2, 4):
        gaps = np.diff(around[::step])
        assert 0.4 * 7.5 * step < gaps.min()
        assert gaps.max() < 1.7 * 7.5 * step
    rise = np.degrees(np.arcsin(eyes[:, 2] / np.linalg.norm(eyes, axis=1)))
    assert rise[::4].max() - rise[::4].min() > 15


def test_a_set_is_a_capture_with_masks_where_the_object_is(flash: Path) -> None:
    folder = flash / "figurine-dark-flash"
    listing = json.loads((folder / "transforms.json").read_text())
    assert [frame["file_path"] for frame in listing["frames"]] == [
        f"images/{k:04d}.jpg" for k in range(0, WALK, 4)
    ]
    for frame in listing["frames"]:
        photo = cv2.imread(str(folder / frame["file_path"]))
        mask = cv2.imread(str(folder / frame["mask_path"]), cv2.IMREAD_GRAYSCALE)
        assert photo is not None
        assert mask is not None
        assert photo.shape == (24, 32, 3)
        assert 0.05 < (mask >= 128).mean() < 0.6
        # white plaster under a flash, in a dark room
        assert photo[mask == 255].mean() > photo[mask == 0].mean() + 20
        pose = np.array(frame["transform_matrix"])
        pixel, _ = cameras.camera(pose, 32, 24).project(np.array([[0.0, 0.0, 6.0]]))
        assert mask[int(pixel[0, 1]), int(pixel[0, 0])] == 255


def test_a_killed_run_goes_on_and_gives_the_same_views(flash: Path) -> None:
    photo = flash / "figurine-dark-flash" / "images" / "0008.jpg"
    before = photo.read_bytes()
    (photo.parent.parent / "masks" / "0008.jpg.png").unlink()
    photo.unlink()
    render_sets(flash, ["figurine-dark-flash"], views=12, **SMALL)  # type: ignore[arg-type]
    assert photo.read_bytes() == before


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        (["rover-moon"], {}, "expected some of rover-black-cloth"),
        (["rover-turntable"], {"views": 13}, "expected one of 48, 24, 12, found 13"),
        (["figurine-dark-flash"], {"views": 12, "samples": 2}, "expected a set made with"),
    ],
)
def test_bad_requests_are_refused(
    flash: Path, names: list[str], options: dict[str, int], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        render_sets(flash, names, **{**SMALL, **options})  # type: ignore[arg-type]
