"""Right cameras explain where photos match; those of other conventions do not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera, from_opengl
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.segment.inspect_photos import inspect
from mattgs_ops.segment.matches_by_cameras import LEAST_EXPLAINED, share_explained
from mattgs_ops.segment.quick_matches import Matches, Pair

Found = dict[Pair, Matches]
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # of a camera's axes in OpenCV's, and back


@pytest.fixture(scope="module")
def matches(box_capture: PreparedCapture) -> Found:
    return dict(inspect(box_capture, estimate=True).matches)


def outwards(camera: Camera) -> Camera:
    """Turn a camera about its x axis, as if its matrix in OpenCV's axes were OpenGL's."""
    turn = OPENGL[:3, :3]
    return replace(camera, rotation=turn @ camera.rotation, translation=turn @ camera.translation)


def inverted(camera: Camera) -> Camera:
    """Read a matrix from world to camera, in OpenGL's axes, as if it were camera-to-world."""
    rotation, translation = from_opengl(OPENGL @ camera.matrix)
    return replace(camera, rotation=rotation, translation=translation)


def mirrored(camera: Camera) -> Camera:
    """Turn the other way around the z axis of a left-handed world."""
    mirror = np.diag([1.0, 1.0, -1.0])
    rotation = mirror @ camera.rotation @ mirror
    return replace(camera, rotation=rotation, translation=mirror @ camera.translation)


def explained(
    capture: PreparedCapture, found: Found, change: Callable[[Camera], Camera]
) -> float | None:
    views = [
        replace(view, camera=change(view.camera) if view.camera else None) for view in capture.views
    ]
    return share_explained(found, views)


@pytest.mark.parametrize("scale", [1.0, 1e-4])
def test_right_cameras_explain_matches_in_any_units(
    box_capture: PreparedCapture, matches: Found, scale: float
) -> None:
    share = explained(
        box_capture, matches, lambda one: replace(one, translation=scale * one.translation)
    )
    assert share is not None
    assert share > 0.9


@pytest.mark.parametrize("wrong", [outwards, inverted, mirrored])
def test_cameras_of_another_convention_explain_none(
    box_capture: PreparedCapture, matches: Found, wrong: Callable[[Camera], Camera]
) -> None:
    share = explained(box_capture, matches, wrong)
    assert share is not None
    assert share < LEAST_EXPLAINED


def test_few_matches_tell_nothing(box_capture: PreparedCapture, matches: Found) -> None:
    assert share_explained({}, box_capture.views) is None
    without = [replace(view, camera=None) for view in box_capture.views]
    assert share_explained(matches, without) is None
