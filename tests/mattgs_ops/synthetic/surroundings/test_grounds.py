"""Grounds: each can be laid, and light and camera do what their names say."""

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the `captures` extra is not installed")

from mattgs_ops.errors import InputError
from mattgs_ops.synthetic import cameras
from mattgs_ops.synthetic.render import develop
from mattgs_ops.synthetic.surfaces.materials import plain
from mattgs_ops.synthetic.surfaces.mesh import box
from mattgs_ops.synthetic.surroundings.grounds import FLASH, Ground, lay
from mattgs_ops.synthetic.tracer import Tracer, choose_variant

WIDTH, HEIGHT = 24, 18
EYE = np.array([0.0, -45.0, 25.0])


@pytest.fixture(scope="module", autouse=True)
def _variant() -> None:
    choose_variant("scalar_rgb")


def shown(ground: Ground) -> np.ndarray:
    """Trace a grey box of 8 cm on a ground; [H, W, 3] 0..255."""
    ground.stage.add(box(8, 8, 8).at(z=ground.top), plain("a0a0a0"), own=True)
    tracer = Tracer(ground.stage, ground.light)
    pose = cameras.look_at(EYE, np.array([0, 0, 3.0]), 0.0)
    if ground.flash:
        tracer.move_lamp(FLASH, EYE + np.array([0, 0, 4]))
    light = tracer.render(pose, WIDTH, HEIGHT, 4, 0)["light"]
    return develop(light, 1.35).astype(float)


def test_cloth_is_black_paper_is_white_and_both_show_the_object() -> None:
    black, white = (
        shown(lay(name, np.random.default_rng(0))) for name in ("black-cloth", "white-sweep")
    )
    corners = np.s_[-3:, :3]
    assert black[corners].mean() < 45
    assert white[corners].mean() > 180
    assert black[8:11, 10:14].mean() > black[corners].mean() + 40


def test_a_flash_falls_off_and_comes_from_the_camera() -> None:
    ground = lay("dark-flash", np.random.default_rng(0))
    image = shown(ground)
    assert image[8:11, 10:14].mean() > 60  # the box's near side is lit
    assert image[0].mean() < 0.6 * image[8:11, 10:14].mean()
    assert ground.spread > lay("wooden-table", np.random.default_rng(0)).spread


def test_a_turntable_carries_its_plate_with_the_object() -> None:
    ground = lay("turntable", np.random.default_rng(0))
    assert ground.follows
    points = np.concatenate([mesh.vertices for mesh, _, _, _ in ground.turning.merged()])
    assert points[:, 2].max() == pytest.approx(ground.top)
    assert len(ground.stage.pieces) > 5


def test_an_unknown_ground_is_refused() -> None:
    with pytest.raises(InputError, match="expected one of black-cloth"):
        lay("lawn", np.random.default_rng(0))
