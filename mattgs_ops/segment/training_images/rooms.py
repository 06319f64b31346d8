"""Rooms for training images: walls, windows, furniture, and what an object is put on.

Photos of things at home and in studios show more than a desk: walls out of focus, windows too
bright for the sensor, shelves, the floor; and between the object and the floor a table, a crate, a
block of foam or a stand. All of that is ground. Light often comes from behind.
"""

from dataclasses import replace

import cv2
import numpy as np

from mattgs_ops.segment.training_images.draw import SUBPIXEL, Canvas, Light, fixed, near_clipped
from mattgs_ops.segment.training_images.solids import (
    Array,
    Colour,
    Face,
    box,
    cylinder,
    random_colour,
    rotation,
    up,
)
from mattgs_ops.segment.training_images.things import clutter

REACH = (3.0, 14.0)  # of the walls from the object's foot, in object widths
HEIGHT = (1.0, 9.0)  # of the ceiling over object and camera
SPARE = 0.6  # between the camera and a wall behind it
AWAY = 1.6  # nearest the middle of furniture comes to the object, plus half its own size
WINDOW_SHARE = 0.5  # of walls
BACKLIT_SHARE = 0.4  # of rooms
FOCUS_SHARE = 0.75  # of rooms whose background is out of focus


def room_light(rng: np.random.Generator, eye: Array) -> Light:
    """Draw a light; at times it stands behind the object, whose front is dark then."""
    light = Light.random(rng)
    if rng.random() > BACKLIT_SHARE:
        return light
    toward = -eye / np.linalg.norm(eye) + rng.normal(0, 0.4, 3)
    toward[2] = abs(float(toward[2])) + 0.3
    toward /= np.linalg.norm(toward)
    return replace(light, direction=toward, ambient=float(rng.uniform(0.15, 0.5)))


def paint_room(canvas: Canvas, points: Array) -> None:
    """Cover the canvas with a room around an object of these points [K, 3], and its support."""
    rng = canvas.rng
    drop = 0.0 if rng.random() < 0.2 else float(rng.uniform(0.8, 4))  # floor under the object
    turn = rotation(rng)
    behind = np.abs(canvas.camera.eye @ turn)[:2] + SPARE
    half = np.maximum(rng.uniform(*REACH, 2), behind)
    highest = max(float(points[:, 2].max()), float(canvas.camera.eye[2]))
    walls = room_walls(rng, half, (-drop, highest + float(rng.uniform(*HEIGHT))), turn)
    canvas.draw(walls, is_object=False)
    for wall in walls[:4]:
        if rng.random() < WINDOW_SHARE:
            open_window(canvas, wall)
        for _ in range(int(rng.integers(0, 3))):
            hung = patch_of(rng, wall, (0.08, 0.3))
            canvas.draw([Face([hung], wall.normal, random_colour(rng), "sheet")], is_object=False)
    for faces in furniture(rng, half, drop, turn, canvas.camera.eye):
        canvas.draw(faces, is_object=False)
    if rng.random() < FOCUS_SHARE:
        canvas.blur(float(rng.uniform(0.5, 9)))
    if drop:
        canvas.draw(support(rng, points, drop), is_object=False)
        if rng.random() < 0.3:
            canvas.sheet(rng.normal(0, 0.5, 2), rng.uniform(0.6, 1.6, 2))


def room_walls(
    rng: np.random.Generator, half: Array, span: tuple[float, float], turn: Array
) -> list[Face]:
    """Return four walls, the floor and the ceiling, all seen from inside.

    ``half`` [2] is half the room's length and width, ``span`` the heights of floor and ceiling.
    """
    floor, ceiling = span
    size = np.array([2 * half[0], 2 * half[1], ceiling - floor])
    faces = box(np.array([0, 0, (floor + ceiling) / 2]), size, (0, 0, 0), "", turn)
    plain = random_colour(rng)
    for face in faces:
        face.normal = -face.normal
        same = rng.random() < 0.6  # most rooms are painted in one colour
        face.colour = plain if same else random_colour(rng)
        face.use = "" if same and rng.random() < 0.5 else "wall"
    lowest = min(faces, key=lambda face: float(face.contours[0][:, 2].mean()))
    lowest.colour, lowest.use = random_colour(rng), "desk"
    return sorted(faces, key=lambda face: abs(float(face.normal[2])))


def patch_of(rng: np.random.Generator, wall: Face, share: tuple[float, float]) -> Array:
    """Return a rectangle [4, 3] on a wall, of so much of its width, a little before it."""
    corner, edges = wall.contours[0][0], wall.contours[0][[1, 3]] - wall.contours[0][0]
    size = rng.uniform(*share, 2) * [1, 2]
    low = rng.uniform(0.02, np.maximum(0.98 - size, 0.03))
    high = np.minimum(low + size, 0.98)
    pairs = ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
    steps = np.array([a * edges[0] + b * edges[1] for a, b in pairs])
    return np.asarray(corner + steps + 0.02 * wall.normal)


def open_window(canvas: Canvas, wall: Face) -> None:
    """Draw a window's panes, near white whatever the light in the room, and what it outshines."""
    rng, side = canvas.rng, canvas.side
    whole = patch_of(rng, wall, (0.15, 0.6))
    panes, value = int(rng.integers(1, 4)), rng.uniform(190, 300)
    tint = np.clip(value + rng.normal(0, 8, 3), 0, 255)
    bright = np.zeros((side, side), np.uint8)
    for k in range(panes):
        a, b = (k + 0.04) / panes, (k + 0.96) / panes
        along = whole[1] - whole[0]
        pane = np.array([whole[0] + a * along, whole[0] + b * along])
        pane = np.concatenate([pane, (pane + whole[3] - whole[0])[::-1]])
        seen = near_clipped(pane, canvas.camera)
        if len(seen) > 2:
            pixels = fixed(canvas.camera.project(seen)[0])
            cv2.fillConvexPoly(bright, pixels, 255, shift=SUBPIXEL)
    share = bright[..., None].astype(np.float32) / 255
    glow = cv2.GaussianBlur(bright, (0, 0), float(rng.uniform(4, 20)) * side / 320)
    share = np.maximum(share, rng.uniform(0, 0.8) * glow[..., None].astype(np.float32) / 255)
    canvas.image = (canvas.image * (1 - share) + tint * share).astype(np.uint8)


def furniture(
    rng: np.random.Generator, half: Array, drop: float, turn: Array, eye: Array
) -> list[list[Face]]:
    """Return boxes, posts and everyday things on the floor and above it, the farthest first."""
    spots: list[tuple[float, list[Face]]] = []
    for _ in range(int(rng.integers(2, 12))):
        size = rng.uniform(0.4, 3.5, 3)
        spread = float(np.linalg.norm(size[:2])) / 2 + AWAY
        spot = turn @ np.array([*(rng.uniform(-1, 1, 2) * half), 0])
        near = float(np.linalg.norm(spot))
        toward_eye = float(spot[:2] @ eye[:2]) / (float(np.linalg.norm(eye[:2])) + 1e-9)
        if near < spread or toward_eye > 0.3 * near:
            continue  # nothing stands in the object or before the camera
        foot = spot - up(drop)
        spots.append((float(np.linalg.norm(spot - eye)), piece(rng, foot, size, turn)))
    return [faces for _, faces in sorted(spots, key=lambda entry: -entry[0])]


def piece(rng: np.random.Generator, foot: Array, size: Array, turn: Array) -> list[Face]:
    """Return one piece: a cupboard, a board on a wall, a post or lamp, or a large thing."""
    kind, colour = rng.random(), random_colour(rng)
    use = "desk" if rng.random() < 0.5 else "sheet" if rng.random() < 0.5 else ""
    if kind < 0.5:
        return box(foot + up(size[2] / 2), size, colour, use, turn)
    if kind < 0.65:
        low = foot + up(float(rng.uniform(1, 4)))
        return box(low, size * [1, 0.4, 0.1], colour, use, turn)
    if kind < 0.8:
        head = foot + up(size[2] * float(rng.uniform(1, 2)))
        return cylinder(foot, head, 0.25 * size[0], colour, use, 16, float(rng.uniform(0.5, 1.5)))
    faces, factor = clutter(rng), float(rng.uniform(1.5, 5))
    for face in faces:
        face.contours = [contour * factor + foot for contour in face.contours]
    return faces


def support(rng: np.random.Generator, points: Array, drop: float) -> list[Face]:
    """Return what stands under the object, its top at height 0: a table, a stand or a block."""
    reach = float(np.linalg.norm(points[:, :2], axis=1).max())
    middle, colour = np.array([*rng.normal(0, 0.06 * reach, 2), 0.0]), random_colour(rng)
    use = "desk" if rng.random() < 0.6 else ""
    draw = rng.random()
    if draw < 0.2:  # a stool, a tin, a round stand
        radius = reach * float(rng.uniform(1.0, 1.6))
        return cylinder(middle - up(drop), middle, radius, colour, use, 32)
    if draw < 0.5:  # a crate, a block of foam, a pedestal
        size = 2 * reach * rng.uniform(1.0, 1.7, 3)
        size[2] = drop if rng.random() < 0.5 else float(rng.uniform(0.1, 0.6)) * drop
        block = box(middle - up(size[2] / 2), size, colour, use, rotation(rng))
        return block if size[2] == drop else [*_table(rng, reach, middle, size[2]), *block]
    return _table(rng, reach, middle, 0.0)


def _table(rng: np.random.Generator, reach: float, middle: Array, below: float) -> list[Face]:
    """Return a table's board, its top ``below`` the object's foot."""
    colour: Colour = random_colour(rng)
    size = np.array([*rng.uniform(1.5, 5, 2) * 2 * reach, rng.uniform(0.05, 0.4)])
    centre = middle - up(below + size[2] / 2) + [*rng.normal(0, 0.3 * reach, 2), 0]
    return box(centre, size, colour, "desk", rotation(rng))
