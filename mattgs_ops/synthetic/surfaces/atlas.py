"""Few big meshes and images instead of many small ones: what makes rendering fast.

Surfaces that reflect alike (same roughness, metallic share and specular after rounding) become one
mesh whose texture coordinates point into one big image. A renderer that compiles and calls code
per surface then has a dozen of them to deal with, not hundreds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.synthetic.surfaces.materials import Image, Material, Part, Stage
from mattgs_ops.synthetic.surfaces.mesh import Mesh, join

ROUGHNESS_STEPS = np.array([0.12, 0.22, 0.3, 0.4, 0.5, 0.6, 0.8])
METALLIC_STEPS = np.array([0.0, 0.4, 1.0])
SPECULAR_STEPS = np.array([0.3, 0.5])
PLAIN = 4  # pixels a plain colour takes in the image, each way
GAP = 2

Finish = tuple[float, float, float]  # roughness, metallic, specular


@dataclass(frozen=True)
class Sheet:
    """One mesh with one image.

    ``own``, ``part`` [M] say for each face whether it is the object's and which small structure;
    ``ink`` [H, W] marks print in the image.
    """

    finish: Finish
    mesh: Mesh
    image: Image
    own: NDArray[np.bool_]
    part: NDArray[np.uint8]
    ink: NDArray[np.bool_]


def pack(stage: Stage) -> list[Sheet]:
    """Merge everything on the stage by finish."""
    groups: dict[Finish, list[tuple[Mesh, Material, Part, bool]]] = {}
    for piece in stage.merged():
        groups.setdefault(finish(piece[1]), []).append(piece)
    return [_sheet(key, groups[key]) for key in sorted(groups)]


def finish(material: Material) -> Finish:
    """Return the rounded roughness, metallic share and specular of a material."""
    values = (material.roughness, material.metallic, material.specular)
    steps = (ROUGHNESS_STEPS, METALLIC_STEPS, SPECULAR_STEPS)
    rounded = [float(s[np.abs(s - value).argmin()]) for value, s in zip(values, steps, strict=True)]
    return rounded[0], rounded[1], rounded[2]


def _sheet(key: Finish, pieces: list[tuple[Mesh, Material, Part, bool]]) -> Sheet:
    materials = list(dict.fromkeys(material for _, material, _, _ in pieces))
    images = [_image(material) for material in materials]
    places, width, height = _shelves([image.shape[:2] for image in images])
    canvas = np.zeros((height, width, 3), dtype=np.uint8)
    ink = np.zeros((height, width), dtype=bool)
    boxes = {}
    for material, image, (x, y) in zip(materials, images, places, strict=True):
        h, w = image.shape[:2]
        canvas[y : y + h, x : x + w] = image
        if material.ink is not None:
            ink[y : y + h, x : x + w] = material.ink
        boxes[material] = _inside(x, y, w, h, width, height)
    moved, own, part = [], [], []
    for mesh, material, kind, is_own in pieces:
        left, top, right, bottom = boxes[material]
        if isinstance(material.colour, tuple):
            left = right = (left + right) / 2
            top = bottom = (top + bottom) / 2
        clipped = Mesh(mesh.vertices, mesh.normals, np.clip(mesh.uvs, 0, 1), mesh.faces)
        moved.append(clipped.with_uv(left, top, right, bottom))
        own.append(np.full(len(mesh.faces), is_own))
        part.append(np.full(len(mesh.faces), int(kind), dtype=np.uint8))
    return Sheet(key, join(moved), canvas, np.concatenate(own), np.concatenate(part), ink)


def _image(material: Material) -> Image:
    if isinstance(material.colour, tuple):
        return np.full((PLAIN, PLAIN, 3), material.colour, dtype=np.uint8)
    return material.colour


def _inside(
    x: int, y: int, w: int, h: int, width: int, height: int
) -> tuple[float, float, float, float]:
    """Return the rectangle between the outer pixels' centres, so that no neighbour bleeds in."""
    return (x + 0.5) / width, (y + 0.5) / height, (x + w - 0.5) / width, (y + h - 0.5) / height


def _shelves(sizes: list[tuple[int, ...]]) -> tuple[list[tuple[int, int]], int, int]:
    """Place rectangles (h, w) on shelves, tallest first; return corners (x, y), width, height."""
    area = sum(h * w for h, w in sizes)
    width = max(int(np.sqrt(area) * 1.1), *(w for _, w in sizes)) + GAP
    places, x, y, tall = [(0, 0)] * len(sizes), 0, 0, 0
    for k in sorted(range(len(sizes)), key=lambda k: -sizes[k][0]):
        h, w = sizes[k]
        if x + w > width:
            x, y, tall = 0, y + tall + GAP, 0
        places[k] = (x, y)
        x, tall = x + w + GAP, max(tall, h)
    return places, width, y + tall
