"""One skin around shapes: closed, of the right volume, melted by the radius asked for, dented."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("skimage")

from mattgs_ops.segment.training_images.figures import Kind, Shape
from mattgs_ops.segment.training_images.traced.skin import dent, melt
from mattgs_ops.synthetic.surfaces.mesh import Mesh

GREY = (0.5, 0.5, 0.5)


def shape(
    kind: Kind, centre: tuple[float, float, float], half: tuple[float, float, float]
) -> Shape:
    return Shape(kind, np.array(centre), np.diag(half), GREY)


def volume(solid: Mesh) -> float:
    """Return the enclosed volume by the divergence theorem: negative when inside out."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def edges_that_are_not_shared_by_two_faces(solid: Mesh) -> int:
    pairs = np.concatenate([solid.faces[:, [0, 1]], solid.faces[:, [1, 2]], solid.faces[:, [2, 0]]])
    return sum(count != 2 for count in Counter(map(tuple, np.sort(pairs, axis=1))).values())


BALL = shape("ball", (0, 0, 0.5), (0.5, 0.5, 0.5))


@pytest.mark.parametrize(
    ("kind", "half", "expected"),
    [
        ("ball", (0.5, 0.3, 0.4), 4 / 3 * np.pi * 0.5 * 0.3 * 0.4),
        ("block", (0.5, 0.3, 0.4), 8 * 0.5 * 0.3 * 0.4),
        ("drum", (0.3, 0.3, 0.4), np.pi * 0.3**2 * 0.8),
    ],
)
def test_a_single_shape_keeps_its_volume_turned_or_not(
    kind: Kind, half: tuple[float, float, float], expected: float
) -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    upright = shape(kind, (0.2, -0.1, 0.5), half)
    turned = Shape(kind, upright.centre, turn @ upright.axes, GREY)
    for solid in (upright, turned):
        mesh = melt([solid], [], blend=0.01)
        assert volume(mesh) == pytest.approx(expected, rel=0.03)
        assert edges_that_are_not_shared_by_two_faces(mesh) == 0
        outward = ((mesh.vertices - solid.centre) * mesh.normals).sum(axis=1)
        assert (outward > 0).all()


def test_shapes_melt_within_the_radius_and_not_beyond_it() -> None:
    two = [shape("ball", (x, 0, 0), (0.3, 0.3, 0.3)) for x in (-0.32, 0.32)]
    apart = melt(two, [], blend=0.01)
    melted = melt(two, [], blend=0.2)
    assert volume(apart) == pytest.approx(2 * 4 / 3 * np.pi * 0.3**3, rel=0.03)
    assert np.abs(apart.vertices[:, 0]).min() > 0.015  # nothing in the gap
    assert np.abs(melted.vertices[:, 0]).min() < 0.015  # a neck across it
    assert volume(melted) > 1.02 * volume(apart)


def test_a_hollow_is_taken_away() -> None:
    bite = shape("block", (0.5, 0, 0.5), (0.5, 1.0, 1.0))
    half = melt([BALL], [bite], blend=0.01)
    assert volume(half) == pytest.approx(volume(melt([BALL], [], blend=0.01)) / 2, rel=0.03)
    assert half.vertices[:, 0].max() < 0.02


def test_thin_shapes_are_not_lost_between_the_cells() -> None:
    wire = shape("drum", (0, 0, 0.5), (0.001, 0.001, 0.5))
    mesh = melt([wire, shape("ball", (0.8, 0, 0.5), (0.2, 0.2, 0.2))], [], blend=0.01)
    on_wire = mesh.vertices[mesh.vertices[:, 0] < 0.3]
    assert np.ptp(on_wire[:, 2]) == pytest.approx(1.0, abs=0.05)
    assert edges_that_are_not_shared_by_two_faces(mesh) == 0


def test_dents_are_as_deep_as_asked_along_the_normals() -> None:
    smooth = melt([BALL], [], blend=0.01)
    rough = dent(smooth, np.random.default_rng(0), 0.01, 0.5)
    moved = ((rough.vertices - smooth.vertices) * smooth.normals).sum(axis=1)
    assert moved.std() == pytest.approx(0.01, rel=1e-6)
    assert np.linalg.norm(rough.vertices - smooth.vertices, axis=1) == pytest.approx(np.abs(moved))
    assert np.linalg.norm(rough.normals, axis=1) == pytest.approx(1.0)
    assert dent(smooth, np.random.default_rng(0), 0.0, 0.5) is smooth


def test_more_falloff_leaves_finer_dents() -> None:
    smooth = melt([BALL], [], blend=0.01)

    def unevenness(falloff: float) -> float:
        rough = dent(smooth, np.random.default_rng(1), 0.005, falloff)
        return float(np.arccos((rough.normals * smooth.normals).sum(axis=1).clip(-1, 1)).mean())

    assert unevenness(0.3) < 0.8 * unevenness(0.9)
