"""Cameras that came along in units, or about an origin, that splats cannot be trained in."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.capture.visual_hull import sample
from mattgs_ops.errors import InputError
from mattgs_ops.sfm.world_units import check_units


def cameras_of(capture: PreparedCapture, scale: float = 1.0, shift: float = 0.0) -> list[Camera]:
    """Return the capture's cameras in a world that is scaled, then shifted along all axes."""
    cameras = [view.camera for view in capture.views if view.camera is not None]
    moved = [c.centre * scale + shift for c in cameras]
    return [
        replace(c, translation=-c.rotation @ centre)
        for c, centre in zip(cameras, moved, strict=True)
    ]


def world(capture: PreparedCapture, scale: float = 1.0, shift: float = 0.0) -> NDArray[np.float64]:
    points = sample(cameras_of(capture), None, 300, np.random.default_rng(0))
    return points * scale + shift


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (1000.0, 0.0), (1.0, 100.0)])
def test_worlds_of_usual_units_pass(
    box_capture: PreparedCapture, scale: float, shift: float
) -> None:
    check_units("box", cameras_of(box_capture, scale, shift), world(box_capture, scale, shift))
    check_units("box", [], np.zeros((0, 3)))


def test_a_world_before_the_near_plane_is_told_by_what_to_multiply(
    box_capture: PreparedCapture,
) -> None:
    small = cameras_of(box_capture, 0.01), world(box_capture, 0.01)
    with pytest.raises(InputError, match=r"nearer than 0\.2 units.* multiply .* by 100"):
        check_units("box", *small)
    check_units("box", cameras_of(box_capture, 0.01 * 100), world(box_capture, 0.01 * 100))


def test_a_far_origin_is_told_by_what_to_subtract(box_capture: PreparedCapture) -> None:
    with pytest.raises(InputError, match=r"too far for 32-bit numbers; subtract \[500"):
        check_units("box", cameras_of(box_capture, 1, 5e6), world(box_capture, 1, 5e6))
