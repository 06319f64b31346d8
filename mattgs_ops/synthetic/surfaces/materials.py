"""Surfaces and the stage that things are put on.

A :class:`Material` is a plain colour or an image with a roughness and a metallic share, as the
principled model of Burley (2012) takes them. A :class:`Stage` collects meshes by material, says
which belong to the object, and which are small structures worth scoring on their own.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.synthetic.surfaces.mesh import Array, Mesh, join

Image = NDArray[np.uint8]


class Part(IntEnum):
    """Small structures, as stored in the id maps."""

    REST = 0
    SCREW = 1
    WIRE = 2
    PRINT = 3


@dataclass(frozen=True, eq=False)
class Material:
    """``colour`` is sRGB 0..255 or an image [H, W, 3] uint8; ``ink`` [H, W] marks print on it."""

    colour: tuple[int, int, int] | Image
    roughness: float = 0.5
    metallic: float = 0.0
    specular: float = 0.5
    ink: NDArray[np.bool_] | None = None


def rgb(values: Array) -> tuple[int, int, int]:
    """Return three values 0..255, cut to whole ones, as a colour."""
    red, green, blue = (int(value) for value in values)
    return red, green, blue


@cache
def plain(colour: str, roughness: float = 0.5, metallic: float = 0.0) -> Material:
    """Return the material of one colour given as ``rrggbb``; equal ones are one material."""
    return Material((*bytes.fromhex(colour),), roughness, metallic)


def printed(image: Image, paper: tuple[int, int, int], roughness: float = 0.45) -> Material:
    """Return a printed surface; what differs from the paper's colour, and its rim, is ink."""
    import cv2

    differs = np.abs(image.astype(np.int16) - np.array(paper, dtype=np.int16)).max(axis=2) > 60
    rim = max(1, min(image.shape[:2]) // 100)
    kernel = np.ones((2 * rim + 1, 2 * rim + 1), dtype=np.uint8)
    ink = cv2.dilate(differs.astype(np.uint8), kernel).astype(bool)
    return Material(image, roughness, ink=ink)


STEEL = plain("c9cbcf", 0.28, 1.0)
DARK_STEEL = plain("55585e", 0.35, 1.0)
ALUMINIUM = plain("d5d7da", 0.42, 1.0)
GOLD = plain("d9ab4e", 0.3, 1.0)
BRASS = plain("c2a050", 0.32, 1.0)
BLACK = plain("17181a", 0.45)
RUBBER = plain("1b1b1c", 0.85)
WHITE = plain("e4e3df", 0.4)


@dataclass
class Stage:
    """What stands on the desk.

    ``pieces`` maps (material, part, is it the object's) to its meshes. ``corners`` holds points
    [K, 3] known to lie on the object, by which masks and poses are checked.
    """

    pieces: dict[tuple[Material, Part, bool], list[Mesh]] = field(default_factory=dict)
    corners: list[Array] = field(default_factory=list)

    def add(self, mesh: Mesh, material: Material, part: Part = Part.REST, *, own: bool) -> None:
        """Put a mesh on the stage; ``own`` says that it belongs to the object."""
        self.pieces.setdefault((material, part, own), []).append(mesh)

    def merged(self) -> list[tuple[Mesh, Material, Part, bool]]:
        """Return one mesh for each material, part and ownership, in the order of first use."""
        return [
            (join(meshes), material, part, own)
            for (material, part, own), meshes in self.pieces.items()
        ]


@dataclass
class Group:
    """Meshes built in a frame of their own and then put on a stage together."""

    items: list[tuple[Mesh, Material, Part]] = field(default_factory=list)

    def add(self, mesh: Mesh, material: Material, part: Part = Part.REST) -> None:
        """Add a mesh."""
        self.items.append((mesh, material, part))

    def absorb(self, other: "Group", matrix: Array) -> None:
        """Add another group's meshes, moved by an affine matrix [4, 4]."""
        self.items += [(mesh.transformed(matrix), mat, part) for mesh, mat, part in other.items]

    def place(self, stage: Stage, matrix: Array, *, own: bool) -> None:
        """Put everything on the stage, moved by an affine matrix [4, 4]."""
        for mesh, material, part in self.items:
            stage.add(mesh.transformed(matrix), material, part, own=own)


def pose(x: float, y: float, z: float, turn: Array | None = None) -> Array:
    """Return the affine matrix that turns by a rotation [4, 4] and then moves."""
    out = np.eye(4) if turn is None else turn.copy()
    out[:3, 3] = [x, y, z]
    return out
