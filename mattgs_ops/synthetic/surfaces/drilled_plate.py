"""A plate full of round holes, as a mesh."""

import numpy as np

from mattgs_ops.synthetic.surfaces.mesh import Mesh, fan, join, quad, wind


def drilled_plate(columns: int, rows: int, pitch: float, hole: float, thickness: float) -> Mesh:
    """Return a flat plate with ``columns`` × ``rows`` round holes of radius ``hole`` right through.

    It is ``columns * pitch`` wide and stands on z = 0.
    """
    angles = np.arange(16) / 16 * 2 * np.pi
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    rim = circle / np.abs(circle).max(axis=1, keepdims=True) * pitch / 2
    parts = []
    for z, side in ((0.0, -1.0), (thickness, 1.0)):
        points = np.column_stack([np.concatenate([rim, circle * hole]), np.full(32, z)])
        up = np.tile([0.0, 0, side], (32, 1))
        faces = np.array(
            [t for i in range(16) for t in fan([i, (i + 1) % 16, 16 + (i + 1) % 16, 16 + i])]
        )
        parts.append(Mesh(points, up, np.zeros((32, 2)), wind(points, up, faces)))
    ends = [np.column_stack([circle * hole, np.full(16, z)]) for z in (0.0, thickness)]
    inward = np.tile(np.column_stack([-circle, np.zeros(16)]), (2, 1))
    wall = np.array(
        [t for i in range(16) for t in fan([i, (i + 1) % 16, 16 + (i + 1) % 16, 16 + i])]
    )
    points = np.concatenate(ends)
    parts.append(Mesh(points, inward, np.zeros((32, 2)), wind(points, inward, wall)))
    cell = join(parts)
    xs, ys = (np.arange(n) - (n - 1) / 2 for n in (columns, rows))
    cells = [cell.at(x * pitch, y * pitch) for x in xs for y in ys]
    return join([*cells, *_skirt(columns * pitch, rows * pitch, thickness)])


def _skirt(width: float, depth: float, thickness: float) -> list[Mesh]:
    across = quad(width, thickness).turned(x=90).at(0, -depth / 2, thickness / 2)
    along = quad(depth, thickness).turned(x=90).at(0, -width / 2, thickness / 2)
    return [across, across.turned(z=180), along.turned(z=90), along.turned(z=-90)]
