"""What a quick look at photos finds: blur, exposure, photos that hang together."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.segment.inspect_photos import (
    STANDS_STILL,
    exposures,
    inspect,
)
from mattgs_ops.segment.quick_matches import linear_light, pairs

WIDTH, HEIGHT = 240, 180


def capture(folder: Path, count: int = 6, *, posed: bool = False) -> PreparedCapture:
    """Photograph one wall of blots, a little farther each time."""
    rng = np.random.default_rng(0)
    wall = np.full((HEIGHT + 20, WIDTH + 20 * count, 3), 120, np.uint8)
    for _ in range(900):
        middle = (int(rng.integers(wall.shape[1])), int(rng.integers(wall.shape[0])))
        colour = tuple(int(c) for c in rng.integers(30, 230, 3))
        cv2.circle(wall, middle, int(rng.integers(2, 7)), colour, -1)
    views = []
    for i in range(count):
        photo = folder / f"{i}.jpg.png"
        cv2.imwrite(str(photo), wall[i : i + HEIGHT, 12 * i : 12 * i + WIDTH])
        lens = Intrinsics(WIDTH, HEIGHT, 200.0, 200.0, WIDTH / 2, HEIGHT / 2)
        camera = Camera(lens, np.eye(3), np.zeros(3)) if posed else None
        views.append(View(f"{i}.jpg", "train", WIDTH, HEIGHT, photo, None, camera))
    return PreparedCapture("wall", folder, tuple(views), "none", "given" if posed else "none")


def change(view: View, pixels: np.ndarray) -> None:
    cv2.imwrite(str(view.photo), pixels)


def photo(view: View) -> np.ndarray:
    return np.asarray(cv2.imread(str(view.photo)))


def test_good_photos_hang_together(tmp_path: Path) -> None:
    found = inspect(capture(tmp_path))
    assert found.placed == 6
    assert min(found.matched) >= 2
    assert found.problems == ("6 photos are few: from 12 on they overlap, 30 are better",)


def test_photos_whose_names_say_nothing_of_their_order_find_each_other(tmp_path: Path) -> None:
    """Two walks in turns: each photo overlaps with one, which is not among those next by name."""
    count, rng = 21, np.random.default_rng(3)
    source = capture(tmp_path, count)
    far = next(n for n in range(count) if n and (0, n) not in pairs(count))
    for index, view in enumerate(source.views):
        if index not in (0, far):
            change(view, photo(source.views[index % 3 + 1]))
    other = cv2.resize(rng.integers(0, 256, (60, 80, 3)).astype(np.uint8), (WIDTH, HEIGHT))
    change(source.views[0], other)
    both = photo(source.views[far])
    both[:, : WIDTH // 2] = other[:, : WIDTH // 2]
    change(source.views[far], both)
    found = inspect(source)
    assert found.placed == count
    assert found.matched[0] == 1


def test_what_is_wrong_is_told_by_name(tmp_path: Path) -> None:
    source = capture(tmp_path)
    rng = np.random.default_rng(1)
    change(source.views[1], cv2.GaussianBlur(photo(source.views[1]), (0, 0), 4))
    change(source.views[2], photo(source.views[2]) // 12)
    change(source.views[4], rng.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8))
    told = "\n".join(inspect(source).problems)
    assert "blurred (next to the others): 1.jpg" in told
    assert "1 too dark: 2.jpg" in told
    assert "not matched with any other photo" in told
    assert "4.jpg" in told.split("not matched")[1]
    assert "of 6 photos hang together" in told


def test_a_cropped_photo_is_told_unless_its_camera_is_known(tmp_path: Path) -> None:
    for posed in (False, True):
        made = capture(tmp_path, posed=posed)
        views = (*made.views[:5], replace(made.views[5], width=WIDTH - 9))
        told = [text for text in inspect(replace(made, views=views)).problems if "size" in text]
        assert ["5.jpg" in text for text in told] == ([] if posed else [True])


def test_dark_photos_are_not_blurred_unless_they_are(tmp_path: Path) -> None:
    source = capture(tmp_path)
    for index in (2, 3):
        change(source.views[index], np.rint(photo(source.views[index]) * 0.3).astype(np.uint8))
    change(source.views[3], cv2.GaussianBlur(photo(source.views[3]), (0, 0), 3))
    told = [one for one in inspect(source).problems if "blurred" in one]
    assert told == ["1 blurred (next to the others): 3.jpg"]


@pytest.mark.parametrize(("ground", "word"), [(255, "too bright"), (0, "too dark")])
def test_a_white_or_a_black_ground_is_no_fault(tmp_path: Path, ground: int, word: str) -> None:
    """As of what was cut out, a white sweep or black cloth; a photo of nothing else is told."""
    source = capture(tmp_path)
    for view in source.views:
        pixels = np.full((HEIGHT, WIDTH, 3), ground, np.uint8)
        pixels[80:110, 90:150] = cv2.add(photo(view), 0 if ground else 60)[80:110, 90:150]
        change(view, pixels)
    change(source.views[3], np.full((HEIGHT, WIDTH, 3), ground, np.uint8))
    assert [one for one in inspect(source).problems if word in one] == [f"1 {word}: 3.jpg"]


def stops_darker(pixels: np.ndarray, stops: float) -> np.ndarray:
    """Expose a photo less: a stop is half of the light, and light is a power of sRGB values."""
    return np.rint(pixels * 2 ** (-stops / 2.2)).astype(np.uint8)


def test_exposures_a_stop_apart_are_told_in_stops(tmp_path: Path) -> None:
    source = capture(tmp_path)
    for view in source.views[::2]:
        change(view, stops_darker(photo(view), 1))
    (told,) = [one for one in inspect(source).problems if "exposure" in one]
    assert float(told.split(": ")[1].split()[0]) == pytest.approx(0.5, abs=0.05)


def test_photos_that_show_darker_things_are_not_exposed_otherwise(tmp_path: Path) -> None:
    source = capture(tmp_path)
    for index, view in enumerate(source.views):
        pixels = photo(view)
        pixels[100:] = 10 + 30 * index  # most of a frame, and nothing to match
        change(view, pixels)
    assert not any("exposure" in one for one in inspect(source).problems)


def test_exposures_follow_from_differences_between_pairs() -> None:
    true = np.array([0.0, 1.0, -1.0, 0.5, -0.5])
    stops = {pair: float(true[pair[1]] - true[pair[0]]) for pair in pairs(5)}
    np.testing.assert_allclose(exposures(stops, 5), true, atol=1e-12)
    np.testing.assert_allclose(exposures({}, 3), 0)  # photos of which nothing is known


def test_a_stop_is_half_of_the_light() -> None:
    grey = np.array([0, 10, 118, 255], dtype=np.uint8)
    np.testing.assert_allclose(linear_light(grey), [0, 0.00304, 0.18116, 1], rtol=2e-3)


def test_photos_that_come_with_cameras_need_no_matches(tmp_path: Path) -> None:
    source = capture(tmp_path, posed=True)
    for view in source.views:
        change(view, np.full((HEIGHT, WIDTH, 3), 100, np.uint8))
    assert inspect(source).placed == 6


@pytest.mark.parametrize("count", [3, 9, 40])
def test_each_pair_is_matched_once_and_every_photo_with_its_neighbours(count: int) -> None:
    found = pairs(count)
    assert len(set(found)) == len(found)
    assert all(a < b < count for a, b in found)
    assert {(i, i + 1) for i in range(count - 1)} <= set(found)


def test_a_camera_that_stands_still_is_told(tmp_path: Path) -> None:
    """A turntable before a tripod: a patch in the middle changes, all around it stays."""
    source = capture(tmp_path)
    wall = photo(source.views[0])
    for view in source.views:
        turned = wall.copy()
        turned[60:120, 80:160] = photo(view)[60:120, 80:160]
        change(view, turned)
    found = inspect(source)
    assert STANDS_STILL in found.problems
    assert found.placed >= 4  # by what the patch shows, which moves, and leaves the frame
    assert STANDS_STILL not in inspect(capture(tmp_path)).problems


def test_what_stands_still_around_an_object_places_no_photo(tmp_path: Path) -> None:
    """A plain object turns: the wall around it matches in all photos, and says nothing of it."""
    source = capture(tmp_path)
    wall, rng = photo(source.views[0]), np.random.default_rng(0)
    for view in source.views:
        turned = wall + rng.integers(0, 3, wall.shape).astype(np.uint8)
        turned[60:120, 80:160] = 200
        change(view, turned)
    found = inspect(source)
    assert found.stands_still
    assert found.placed == 1


def test_photos_that_came_without_a_camera_are_named(tmp_path: Path) -> None:
    source = capture(tmp_path, posed=True)
    views = (replace(source.views[0], camera=None), *source.views[1:])
    found = inspect(replace(source, views=views))
    assert (found.placed, len(found.matches)) == (5, 0)
    assert "1 came without a camera: 0.jpg" in found.problems
    anew = inspect(replace(source, views=views), estimate=True)
    assert anew.placed == 6
    assert anew.matches
