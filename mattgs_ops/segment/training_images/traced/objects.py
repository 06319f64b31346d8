"""Random objects as triangle meshes, so that they can be traced with the light of real places.

``things`` are flat faces, each a fan of triangles; ``figures`` are balls, blocks and drums, each a
stretched unit mesh; ``sculptures`` are one skin. All stand on z = 0 around the origin, about one
unit wide; here they are put on a stage of the tracer, centimetres.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from mattgs_ops.segment.training_images.figures import Figure, Shape
from mattgs_ops.segment.training_images.organic import surface
from mattgs_ops.segment.training_images.solids import Array, Colour, Face
from mattgs_ops.segment.training_images.textures import Bank

LIFT = 0.03  # centimetres that paint on a face floats above it
METAL_SHARE = 0.25  # of parts that are bare metal
STONE = (0.6, 0.95)  # roughness of figures that are not glossy: plaster, stone, wood
SEGMENTS = 24  # around a ball or a drum
SKIN = 384  # pixels of a sculpture's texture


@dataclass(frozen=True)
class Stuff:
    """What sculptures are made of: mean ``colour``, RGB 0..1, range of ``roughness``."""

    colour: Colour
    roughness: tuple[float, float]
    metallic: float = 0.0


STUFFS = (
    Stuff((0.8, 0.78, 0.73), (0.4, 0.9)),  # marble, plaster
    Stuff((0.55, 0.52, 0.47), (0.6, 0.95)),  # sandstone
    Stuff((0.3, 0.29, 0.28), (0.4, 0.9)),  # basalt, slate
    Stuff((0.22, 0.18, 0.12), (0.25, 0.6), 1.0),  # bronze
    Stuff((0.3, 0.38, 0.33), (0.4, 0.8)),  # its green
    Stuff((0.5, 0.32, 0.18), (0.3, 0.8)),  # wood
    Stuff((0.28, 0.18, 0.11), (0.3, 0.8)),  # dark wood, leather, rust
    Stuff((0.62, 0.35, 0.24), (0.5, 0.9)),  # fired clay
    Stuff((0.82, 0.74, 0.58), (0.3, 0.7)),  # bone, ivory
    Stuff((0.6, 0.6, 0.62), (0.15, 0.5), 1.0),  # iron, silver
    Stuff((0.7, 0.15, 0.12), (0.15, 0.9)),  # painted, cloth
    Stuff((0.15, 0.25, 0.6), (0.15, 0.9)),
    Stuff((0.85, 0.7, 0.2), (0.15, 0.9)),
    Stuff((0.2, 0.5, 0.25), (0.15, 0.9)),
    Stuff((0.06, 0.06, 0.07), (0.15, 0.9)),
)


def put_thing(
    stage: Any, thing: Sequence[Face], top: float, scale: float, bank: Bank, rng: Generator
) -> None:
    """Put faces on the stage as the object, ``scale`` centimetres to the unit, at ``top``."""
    from mattgs_ops.synthetic.surfaces.materials import Material

    materials: dict[tuple[Colour, str], Any] = {}
    for face in thing:
        key = (face.colour, face.use)
        if key not in materials:
            rough = float(rng.uniform(0.15, 0.8))
            if face.use:
                materials[key] = _patterned(face.colour, face.use, rough, bank, rng)
            else:
                metal = float(rng.random() < METAL_SHARE)
                materials[key] = Material(_bytes(face.colour), rough, metal)
        for mesh in _meshes_of_face(face, scale, top):
            stage.add(mesh, materials[key], own=True)


def put_figure(
    stage: Any, figure: Figure, top: float, scale: float, bank: Bank, rng: Generator
) -> None:
    """Put a figure's shapes on the stage as the object, as ``put_thing`` does."""
    from mattgs_ops.synthetic.surfaces.materials import Material

    rough = float(rng.uniform(0.15, 0.5)) if figure.gloss else float(rng.uniform(*STONE))
    metal = float(figure.gloss > 0 and rng.random() < METAL_SHARE)
    materials: dict[Colour, Any] = {}
    for shape in figure.shapes:
        if shape.colour not in materials:
            materials[shape.colour] = (
                _patterned(shape.colour, "object", rough, bank, rng)
                if figure.pattern
                else Material(_bytes(shape.colour), rough, metal)
            )
        stage.add(_mesh_of_shape(shape, scale, top), materials[shape.colour], own=True)


def put_sculpture(stage: Any, top: float, scale: float, bank: Bank, rng: Generator) -> Array:
    """Put a random sculpture on the stage as the object; return its points [K, 3], in units."""
    from mattgs_ops.segment.training_images.traced.sculptures import random_sculpture
    from mattgs_ops.synthetic.surfaces.materials import Material

    mesh = random_sculpture(rng)
    stuff = STUFFS[int(rng.integers(len(STUFFS)))]
    tone = np.clip(np.array(stuff.colour) * rng.uniform(0.6, 1.4) + rng.normal(0, 0.04, 3), 0.02, 1)
    image = surface(
        rng, SKIN, bank.pick(rng, "object"), (float(tone[0]), float(tone[1]), float(tone[2]))
    )
    calm = float(rng.uniform(0, 1)) if rng.random() < 0.7 else 0.0
    skin = ((1 - calm) * image + calm * 255 * tone).astype(np.uint8)
    rough = float(rng.uniform(*stuff.roughness))
    placed = np.diag([scale, scale, scale, 1.0])
    placed[2, 3] = top
    stage.add(mesh.transformed(placed), Material(skin, rough, stuff.metallic), own=True)
    return mesh.vertices[:: max(1, len(mesh.vertices) // 500)]


def _patterned(colour: Colour, use: str, rough: float, bank: Bank, rng: Generator) -> Any:
    """Return a material of two tones of a colour, mixed by one of the bank's patterns."""
    from mattgs_ops.synthetic.surfaces.materials import Material

    share = bank.pick(rng, use)[..., None].astype(np.float32) / 255
    tone = np.array(_bytes(colour))
    other = tone * rng.uniform(0.2, 0.8)
    return Material((share * tone + (1 - share) * other).astype(np.uint8), rough)


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (int(255 * channel) for channel in colour)
    return red, green, blue


def _mesh_of_shape(shape: Shape, scale: float, top: float) -> Any:
    """Return the unit ball, cube or cylinder, stretched and moved as the shape says."""
    from mattgs_ops.synthetic.surfaces import mesh

    if shape.kind == "ball":
        unit = mesh.ball(1.0, SEGMENTS)
    elif shape.kind == "block":
        unit = mesh.box(2, 2, 2).at(z=-1)
    else:
        unit = mesh.cylinder(1.0, 2.0, segments=SEGMENTS).at(z=-1)
    placed = np.eye(4)
    placed[:3, :3] = scale * shape.axes
    placed[:3, 3] = scale * shape.centre + [0, 0, top]
    return unit.transformed(placed)


def _meshes_of_face(face: Face, scale: float, top: float) -> list[Any]:
    """One fan of triangles, or two back to back where the face is seen from both sides."""
    from mattgs_ops.synthetic.surfaces.mesh import Mesh

    points: Array = face.contours[0] * scale + [0, 0, top]
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        return []
    normal /= length
    fan = np.array([[0, i, i + 1] for i in range(1, len(points) - 1)])
    edge = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    plane = (points - points[0]) @ np.stack([edge, np.cross(normal, edge)], 1)
    uvs = (plane - plane.min(0)) / np.maximum(np.ptp(plane, axis=0).max(), 1e-9)
    sides = (1.0, -1.0) if not face.normal.any() else (1.0 if face.normal @ normal > 0 else -1.0,)
    meshes = []
    for side in sides:
        lift = LIFT if face.decal or len(sides) == 2 else 0.0
        placed = points + side * lift * normal
        normals = np.tile(side * normal, (len(points), 1))
        meshes.append(Mesh(placed, normals, uvs, fan if side > 0 else fan[:, ::-1]))
    return meshes
