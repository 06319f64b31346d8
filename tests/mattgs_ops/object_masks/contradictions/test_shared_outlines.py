"""Masks that other masks contradict through the cameras: a bar that points away from the middle."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.masks import Mask, mask_name
from mattgs_ops.capture.scene import Scene, Split, View
from mattgs_ops.object_masks.contradictions.shared_outlines import masks_at_shared_outlines
from tests.mattgs_ops.object_masks.ball import CENTRE, HEIGHT, VIEWS, WIDTH, orbit

BAR = CENTRE + np.linspace(0.1, 1.2, 12)[:, None] * np.array([1.0, 0, 0])  # one end in the middle
TURNED = np.diag([-1.0, -1.0, 1.0])  # half a turn about the orbit's axis
ANYWHERE = np.zeros((HEIGHT, WIDTH), np.uint8)


def seen(camera: Camera) -> Mask:
    """Draw the bar, 0.3 thick, as a camera sees it."""
    mask = ANYWHERE.copy()
    places, depths = camera.project(BAR)
    for (x, y), depth in zip(places, depths, strict=True):
        radius = round(0.15 * camera.intrinsics.fx / depth)
        cv2.circle(mask, (round(x), round(y)), radius, 255, cv2.FILLED)
    return mask


def half_a_turn_away(camera: Camera) -> Camera:
    return replace(camera, rotation=camera.rotation @ TURNED)


def scene(
    folder: Path, masks: list[Mask], cameras: list[Camera | None], held_out: int = 0
) -> Scene:
    """Write masks; the first views are held out."""
    (folder / "masks").mkdir()
    views = []
    for index, (mask, camera) in enumerate(zip(masks, cameras, strict=True)):
        path = folder / "masks" / mask_name(f"{index}.jpg")
        cv2.imwrite(str(path), mask)
        split: Split = "test" if index < held_out else "train"
        views.append(View(f"{index}.jpg", split, WIDTH, HEIGHT, path, path, camera))
    return Scene("bar", folder, tuple(views), {})


def test_right_masks_and_cameras_contradict_nothing(tmp_path: Path) -> None:
    found = masks_at_shared_outlines(scene(tmp_path, [*map(seen, orbit())], [*orbit()]))
    assert found is not None
    assert (found.compared, found.contradict) == (VIEWS, ())
    assert found.mean > 0.6


@pytest.mark.parametrize("held_out", [0, 1])
def test_a_camera_half_a_turn_away_is_named_held_out_or_not(tmp_path: Path, held_out: int) -> None:
    """The bar then points to the other side of the middle."""
    cameras: list[Camera | None] = [half_a_turn_away(orbit()[0]), *orbit()[1:]]
    found = masks_at_shared_outlines(scene(tmp_path, [*map(seen, orbit())], cameras, held_out))
    assert found is not None
    assert found.contradict == ("0.jpg",)


def test_masks_in_the_wrong_order_are_named(tmp_path: Path) -> None:
    masks = [*map(seen, orbit())]
    masks[2], masks[7] = masks[7], masks[2]  # from opposite sides
    found = masks_at_shared_outlines(scene(tmp_path, masks, [*orbit()]))
    assert found is not None
    assert set(found.contradict) == {"2.jpg", "7.jpg"}


def test_views_without_a_camera_or_an_object_are_not_compared(tmp_path: Path) -> None:
    masks = [ANYWHERE, *map(seen, orbit()[1:])]
    cameras: list[Camera | None] = [*orbit()]
    cameras[3] = None
    found = masks_at_shared_outlines(scene(tmp_path, masks, cameras))
    assert found is not None
    assert (found.compared, found.contradict) == (VIEWS - 2, ())


def test_of_masks_that_share_no_volume_nothing_is_said(tmp_path: Path) -> None:
    assert masks_at_shared_outlines(scene(tmp_path, [ANYWHERE] * VIEWS, [*orbit()])) is None
