"""Eight bits from floats, and the seconds of each view."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera
from mattgs_ops.splat import render as render_module
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import Rendering, render
from mattgs_ops.splat.render import render_view, time_views
from mattgs_ops.timing import stopwatch

MakeSplats = Callable[[int, int], Splats]
MakeCameras = Callable[..., list[Camera]]


def test_a_view_is_clamped_and_rounded_to_nearest(
    make_splats: MakeSplats, make_cameras: MakeCameras
) -> None:
    splats, camera = make_splats(50, 0), make_cameras(3)[1]
    splats.sh_dc *= 3  # brighter than white in places
    floats = render(splats, camera, (0.3, 0.5, 0.7)).image.numpy()
    assert floats.max() > 1
    found = render_view(splats, camera, (0.3, 0.5, 0.7))
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, np.rint(np.clip(floats, 0, 1) * np.float32(255)))


def test_views_are_timed_in_turn_and_the_warm_up_does_not_count(
    make_splats: MakeSplats, make_cameras: MakeCameras, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that renderings alone advance: 10 ms for the first view, 30 ms for the second."""
    now, rendered = [0.0], []

    def slow(splats: Splats, camera: Camera, *rest: Any, **options: Any) -> Rendering:
        rendered.append(camera)
        now[0] += 0.01 if camera is cameras[0] else 0.03
        return render(splats, camera, *rest, **options)

    cameras = make_cameras(2, 8, 8)
    monkeypatch.setattr(render_module, "render", slow)
    monkeypatch.setattr(stopwatch, "seconds", lambda: now[0])
    timed = list(itertools.islice(time_views(make_splats(3, 0), cameras), 5))
    assert [index for index, _ in timed] == [0, 1, 0, 1, 0]
    assert [seconds for _, seconds in timed] == pytest.approx([0.01, 0.03, 0.01, 0.03, 0.01])
    assert len(rendered) == 5 + 2, "each view once before the clock counts"


def test_without_views_there_is_nothing_to_time(make_splats: MakeSplats) -> None:
    with pytest.raises(ValueError, match="at least one camera"):
        next(time_views(make_splats(3, 0), []))
