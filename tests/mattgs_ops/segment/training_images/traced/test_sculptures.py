"""Sculptures: every family stands on the ground, about one unit wide, closed, from its seed."""

import numpy as np
import pytest

pytest.importorskip("skimage")

from mattgs_ops.segment.training_images.traced.sculptures import FAMILIES, random_sculpture
from mattgs_ops.segment.training_images.traced.skin import melt


@pytest.mark.parametrize("family", range(len(FAMILIES)))
def test_a_family_gives_one_solid_of_about_the_size_of_other_objects(family: int) -> None:
    solids, hollows = FAMILIES[family](np.random.default_rng(family))
    mesh = melt(solids, hollows, blend=0.03)
    assert np.isfinite(mesh.vertices).all()
    assert 0.3 < np.ptp(mesh.vertices, axis=0).max() < 2.5
    assert mesh.faces.max() < len(mesh.vertices)
    assert ((mesh.uvs >= 0) & (mesh.uvs <= 1)).all()


def test_a_sculpture_stands_on_the_ground_and_follows_from_its_seed() -> None:
    seen = set()
    for seed in range(6):
        first, again = (random_sculpture(np.random.default_rng(seed)) for _ in range(2))
        assert np.array_equal(first.vertices, again.vertices)
        assert first.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)
        seen.add(len(first.vertices))
    assert len(seen) == 6
