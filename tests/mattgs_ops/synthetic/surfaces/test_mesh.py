"""Solids are closed, face outwards and have the size asked for."""

from pathlib import Path

import numpy as np
import pytest

from mattgs_ops.synthetic.surfaces import mesh
from mattgs_ops.synthetic.surfaces.drilled_plate import drilled_plate
from mattgs_ops.synthetic.surfaces.mesh import Mesh


def volume(solid: Mesh) -> float:
    """Return the enclosed volume by the divergence theorem: negative when inside out."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


SQUARE = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]


@pytest.mark.parametrize(
    ("solid", "expected", "tolerance"),
    [
        (mesh.box(2, 3, 4, 0.01), 24.0, 0.01),
        (mesh.cylinder(1, 2, 0.001, 256), 2 * np.pi, 0.01),
        (mesh.ball(1, 96), 4 / 3 * np.pi, 0.01),
        (mesh.prism(SQUARE, 3, 0.001), 12.0, 0.01),
        (drilled_plate(5, 4, 1.0, 0.25, 0.2), 4.0 - 20 * 0.25**2 * np.pi * 0.2, 0.03),
    ],
    ids=["box", "cylinder", "ball", "prism", "drilled_plate"],
)
def test_a_solid_encloses_its_volume(solid: Mesh, expected: float, tolerance: float) -> None:
    assert volume(solid) == pytest.approx(expected, rel=tolerance)
    assert np.allclose(np.linalg.norm(solid.normals, axis=1), 1)
    assert solid.faces.max() < len(solid.vertices)


def test_faces_are_wound_like_their_normals() -> None:
    for solid in (mesh.box(1, 2, 3), mesh.tube(mesh.curve([[0, 0, 0], [1, 0, 1], [2, 1, 0]]), 0.1)):
        a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
        front = np.cross(b - a, c - a)
        assert ((front * solid.normals[solid.faces].sum(axis=1)).sum(axis=1) >= 0).all()


def test_turning_and_moving_is_a_rigid_motion() -> None:
    solid = mesh.box(1, 2, 3).turned(20, -40, 70).at(1, 2, 3)
    assert volume(solid) == pytest.approx(volume(mesh.box(1, 2, 3)))
    quarter = mesh.rotation(z=90)
    assert np.allclose(quarter[:3, :3] @ [1, 0, 0], [0, 1, 0])


def test_a_curve_passes_through_its_points() -> None:
    points = [[0, 0, 0], [1, 2, 0], [3, 1, 1], [4, 4, 2]]
    path = mesh.curve(points, 10)
    assert np.allclose(path[::10], points)


def test_a_ply_holds_what_was_written(tmp_path: Path) -> None:
    solid = mesh.cylinder(1, 2)
    mesh.write_ply(solid, tmp_path / "a.ply")
    head, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    assert f"element vertex {len(solid.vertices)}".encode() in head
    assert len(body) == len(solid.vertices) * 8 * 4 + len(solid.faces) * 13
    first = np.frombuffer(body[:32], dtype="<f4")
    assert np.allclose(first[:3], solid.vertices[0], atol=1e-6)
