"""A tracer that takes surfaces from another one shows the same as one that loads them itself."""

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the `captures` extra is not installed")

from mattgs_ops.synthetic import cameras, tracer
from mattgs_ops.synthetic.surfaces.atlas import Sheet
from mattgs_ops.synthetic.surfaces.materials import Material, Stage, plain
from mattgs_ops.synthetic.surfaces.mesh import box, quad
from mattgs_ops.synthetic.tracer import Tracer, choose_variant, room_light

POSE = cameras.look_at(np.array([20.0, -15.0, 20.0]), np.zeros(3), 0.0)


def staged(seed: int, *, height: float) -> Stage:
    """Return a box of that height, printed with a seed's noise, on a rough table."""
    image = np.random.default_rng(seed).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    stage = Stage()
    stage.add(quad(80, 80), plain("a08060", 0.8), own=False)
    stage.add(box(9, 9, height), Material(image, 0.3), own=True)
    return stage


def seen(traced: Tracer) -> np.ndarray:
    return traced.render(POSE, 32, 24, 1, 0)["light"]


def test_only_surfaces_that_look_the_same_are_taken_from_another_tracer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    choose_variant("scalar_rgb")
    first, other = Tracer(staged(0, height=3), room_light()), staged(1, height=5)
    prepare = tracer._surface
    made: list[float] = []

    def counted(sheet: Sheet) -> object:
        made.append(sheet.finish[0])
        return prepare(sheet)

    monkeypatch.setattr(tracer, "_surface", counted)
    anew = seen(Tracer(other, room_light()))
    assert made == [0.3, 0.8]
    assert np.array_equal(seen(Tracer(other, room_light(), first)), anew)
    assert made == [0.3, 0.8, 0.3], "the table's was there, the other print was not"
    assert not np.array_equal(seen(first), anew)
