"""A small painter's-algorithm renderer for training images.

Faces are sorted by depth, clipped at the near plane, filled with a colour or with a pattern in
correct perspective, and shaded by one directional light with gloss. Pixels are RGB uint8; the mask
is kept beside the image: what the object covers last is 255.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.training_images.solids import Array, Colour, Face, random_colour
from mattgs_ops.segment.training_images.textures import SIZE, Bank, Pattern

NEAR = 0.05  # world units; the object is about one unit wide
SUBPIXEL = 4  # bits after the point in OpenCV's integer polygon coordinates
DECAL_LIFT = 0.02  # world units that paint on a face counts as nearer than the face
SMALL_FACE = 150  # pixels of bounding box under which a pattern cannot be seen


@dataclass(frozen=True)
class Camera:
    """A pinhole camera on a square canvas that stands for a photo of some aspect ratio."""

    rotation: Array  # [3, 3] world to camera, z forward
    eye: Array  # [3]
    scale: Array  # [2] focal lengths, pixels
    side: int
    roll: float

    @classmethod
    def facing(
        cls, eye: Array, target: Array, side: int, focal: float, aspect: float, roll: float
    ) -> "Camera":
        """Look from ``eye`` to ``target``; ``focal`` is in units of the photo's longer side."""
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right) + 1e-9
        down = np.cross(forward, right)
        c, s = np.cos(roll), np.sin(roll)
        rows = np.stack([c * right + s * down, c * down - s * right, forward])
        scale = focal * side * np.array([max(1, 1 / aspect), max(1, aspect)])
        return cls(rows, eye, scale, side, float(roll))

    def project(self, points: Array) -> tuple[Array, Array]:
        """[K, 3] world to [K, 2] pixels and [K] depths; depths below NEAR are clamped to it."""
        seen = (points - self.eye) @ self.rotation.T
        depth = np.maximum(seen[:, 2], NEAR)
        return seen[:, :2] / depth[:, None] * self.scale + self.side / 2, seen[:, 2]

    def homography(self, origin: Array, u: Array, v: Array) -> Array:
        """Plane coordinates (a, b) of ``origin + a u + b v`` to homogeneous pixels, [3, 3]."""
        intrinsics = np.array(
            [[self.scale[0], 0, self.side / 2], [0, self.scale[1], self.side / 2], [0, 0, 1]]
        )
        columns = np.stack([u, v, origin - self.eye], axis=1)
        return np.asarray(intrinsics @ self.rotation @ columns)


@dataclass(frozen=True)
class Light:
    """One distant light, its share against the ambient one, and how dark shadows are."""

    direction: Array  # from the surface to the light
    ambient: float
    gloss: float
    shadow: float
    softness: float

    @classmethod
    def random(cls, rng: np.random.Generator) -> "Light":
        """Draw a light from above."""
        azimuth, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.5)
        direction = np.array([np.cos(azimuth), np.sin(azimuth), height])
        direction /= np.linalg.norm(direction)
        ambient, gloss = float(rng.uniform(0.35, 0.8)), float(rng.uniform(0, 0.5))
        return cls(direction, ambient, gloss, float(rng.uniform(0.15, 0.75)), rng.uniform(0.3, 4))


class Canvas:
    """The image and mask under way; see the methods for what can be put on them."""

    def __init__(
        self, side: int, camera: Camera, light: Light, bank: Bank, rng: np.random.Generator
    ) -> None:
        self.image = np.zeros((side, side, 3), np.uint8)
        self.mask = np.zeros((side, side), np.uint8)
        self.camera, self.light, self.bank, self.rng, self.side = camera, light, bank, rng, side

    def wall(self) -> None:
        """Cover everything with a pattern seen from the front, often out of focus."""
        rng, table = self.rng, self.table(random_colour(self.rng))
        zoom, angle = rng.uniform(0.3, 1.6), rng.uniform(-0.2, 0.2)
        matrix = cv2.getRotationMatrix2D((SIZE / 2, SIZE / 2), float(np.degrees(angle)), zoom)
        pattern = self.bank.pick(rng, "wall")
        flags = cv2.INTER_LINEAR
        size = (self.side, self.side)
        shown = cv2.warpAffine(pattern, matrix, size, flags=flags, borderMode=cv2.BORDER_REFLECT)
        self.image = table[shown]
        if rng.random() < 0.6:
            self.blur(float(rng.uniform(1, 6)))

    def plane(self, use: str, extent: float, height: float) -> None:
        """Draw a large horizontal square around the origin: the desk's top."""
        angle = self.rng.uniform(0, np.pi / 2)
        u = np.array([np.cos(angle), np.sin(angle), 0]) * extent
        v = np.array([-np.sin(angle), np.cos(angle), 0]) * extent
        corners = np.array([u + v, u - v, -u - v, v - u]) + np.array([0, 0, height])
        up = np.array([0, 0, 1.0])
        self._paint(Face([corners], up, random_colour(self.rng), use), self.rng.uniform(40, 160))

    def sheet(self, place: Array, size: Array) -> None:
        """Lay a sheet of paper, mat or cloth on the desk."""
        angle = self.rng.uniform(0, np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        square = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * size / 2 @ turn.T + place
        corners = np.concatenate([square, np.zeros((4, 1))], axis=1)
        up = np.array([0, 0, 1.0])
        self._paint(Face([corners], up, random_colour(self.rng), "sheet"), SIZE / float(max(size)))

    def shadows(self, faces: list[Face]) -> None:
        """Darken the desk where faces stand between it and the light, and softly around them."""
        toward = self.light.direction
        contours = [face.contours[0] for face in faces]
        thrown = [c - toward * (c[:, 2:] / toward[2]) for c in contours]
        self.darken(thrown, [c * [1, 1, 0] for c in contours if c[:, 2].min() < 0.15])

    def darken(self, thrown: list[Array], under: list[Array]) -> None:
        """Darken convex polygons [K, 3] on the ground: shadows, and what lies under things."""
        sigma = self.light.softness * self.side / 160
        dark = np.zeros((self.side, self.side), np.float32)
        blurs = ((thrown, 1.0, sigma), (under, 0.8, 3 * sigma + 1))
        for polygons, strength, blur in blurs:
            if polygons:
                shade = np.zeros((self.side, self.side), np.uint8)
                pixels, depth = self.camera.project(np.concatenate(polygons))
                self._fill_all(shade, polygons, pixels, depth)
                soft = cv2.GaussianBlur(shade, (0, 0), blur).astype(np.float32)
                dark = np.maximum(dark, strength * soft)
        kept = 1 - self.light.shadow * dark[..., None] / 255
        self.image = (self.image * kept).astype(np.uint8)

    def _fill_all(
        self, target: NDArray[np.uint8], polygons: list[Array], pixels: Array, depth: Array
    ) -> None:
        whole, start = fixed(pixels), 0
        visible = depth > NEAR
        for polygon in polygons:
            end = start + len(polygon)
            if visible[start:end].all():
                cv2.fillConvexPoly(target, whole[start:end], 255, shift=SUBPIXEL)
            start = end

    def blur(self, sigma: float) -> None:
        """Put everything drawn so far out of focus; ``sigma`` for a canvas of 320."""
        self.image = cv2.GaussianBlur(self.image, (0, 0), sigma * self.side / 320)

    def draw(self, faces: list[Face], *, is_object: bool) -> None:
        """Draw faces from far to near, skipping those that look away."""
        sizes = np.array([len(face.contours[0]) for face in faces])
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        points = np.concatenate([face.contours[0] for face in faces])
        toward = self.camera.eye - np.add.reduceat(points, starts) / sizes[:, None]
        normals = np.array([face.normal for face in faces])
        shown = ((normals * toward).sum(1) > 0) | (np.abs(normals).sum(1) == 0)
        distance = np.linalg.norm(toward, axis=1)
        distance -= DECAL_LIFT * np.array([face.decal for face in faces])
        pixels, depth = self.camera.project(points)
        nearest = np.minimum.reduceat(depth, starts)
        for i in np.argsort(-distance):
            if shown[i]:
                outline = pixels[starts[i] : starts[i] + sizes[i]] if nearest[i] > NEAR else None
                density = SIZE / self.rng.uniform(0.4, 2)
                self._paint(faces[i], density, 255 if is_object else 0, outline)

    def table(self, colour: Colour) -> NDArray[np.uint8]:
        """Return 256 RGB colours from a random second colour to ``colour``."""
        rng = self.rng
        other = np.array(random_colour(rng)) if rng.random() < 0.4 else np.array(colour) * 0.5
        if rng.random() < 0.25:
            other = np.clip(np.array(colour) + rng.normal(0, 0.1, 3), 0, 1)
        steps = np.linspace(0, 1, 256)[:, None]
        mixed = other * (1 - steps) + np.array(colour) * steps
        table: NDArray[np.uint8] = (mixed * 255).astype(np.uint8)
        return table

    def _paint(
        self, face: Face, density: float, covers: int = 0, outline: Array | None = None
    ) -> None:
        contours = face.contours
        if outline is None:
            contours = [near_clipped(c, self.camera) for c in contours]
            if len(contours[0]) < 3:
                return
            outline = self.camera.project(contours[0])[0]
        projected = [outline, *(self.camera.project(c)[0] for c in contours[1:] if len(c) > 2)]
        (left, top), (right, bottom) = outline.min(0).tolist(), outline.max(0).tolist()
        low = (int(min(max(left, 0), self.side)), int(min(max(top, 0), self.side)))
        high = (int(min(right + 2, self.side)), int(min(bottom + 2, self.side)))
        width, height = high[0] - low[0], high[1] - low[1]
        if width <= 0 or height <= 0:
            return
        light, strength = self.light, self._shade(face)
        polygons = [fixed(p - low) for p in projected]
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        if width * height < SMALL_FACE or (not face.use and light.gloss < 0.1):
            colour = [min(255.0, 255 * c * strength) for c in face.colour]
            patch = np.ascontiguousarray(self.image[window])
            cv2.fillPoly(patch, polygons, colour, shift=SUBPIXEL)
            self.image[window] = patch
        else:
            inside = np.zeros((height, width), np.uint8)
            cv2.fillPoly(inside, polygons, 255, shift=SUBPIXEL)
            skin = self._skin(face, contours[0], low, (width, height), density, strength)
            cv2.copyTo(skin, inside, self.image[window])
        patch = np.ascontiguousarray(self.mask[window])
        cv2.fillPoly(patch, polygons, covers, shift=SUBPIXEL)
        self.mask[window] = patch

    def _shade(self, face: Face) -> float:
        normal = face.normal if face.normal.any() else np.array([0, 0, 1.0])
        diffuse = max(0.0, float(normal @ self.light.direction))
        return self.light.ambient + (1 - self.light.ambient) * diffuse

    def _skin(
        self,
        face: Face,
        outline: Array,
        low: tuple[int, int],
        size: tuple[int, int],
        density: float,
        strength: float,
    ) -> NDArray[np.uint8]:
        """Return the face's window: its pattern in perspective, shaded, with a sheen across it."""
        rng = self.rng
        if face.use:
            pattern: Pattern = self.bank.pick(rng, face.use)
            table = self.table(face.colour)
            edge = outline[1] - outline[0]
            u = edge / (np.linalg.norm(edge) + 1e-9)
            normal = np.cross(edge, outline[2] - outline[0])
            v = np.cross(normal / (np.linalg.norm(normal) + 1e-9), u)
            matrix = self.camera.homography(outline[0], u / density, v / density)
            matrix = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]]) @ matrix
            shift = np.eye(3)
            shift[:2, 2] = -rng.uniform(0, SIZE, 2)
            flags, border = cv2.INTER_LINEAR, cv2.BORDER_REFLECT
            if abs(np.linalg.det(matrix)) < 1e-12:
                shown = np.full(size[::-1], 128, np.uint8)
            else:
                shown = cv2.warpPerspective(
                    pattern, matrix @ shift, size, flags=flags, borderMode=border
                )
            skin = table[shown]
        else:
            colour = np.array(face.colour) * 255
            skin = np.broadcast_to(colour.astype(np.uint8), (size[1], size[0], 3))
        a, b = rng.normal(0, 0.2, 2) * (0.3 + self.light.gloss)
        shine = strength + a * np.linspace(-1, 1, size[0], dtype=np.float32)
        shine = shine[None] + b * np.linspace(-1, 1, size[1], dtype=np.float32)[:, None]
        lit = skin * np.maximum(shine, 0.05)[..., None].astype(np.float32)
        return np.asarray(cv2.convertScaleAbs(lit), dtype=np.uint8)


def near_clipped(contour: Array, camera: Camera) -> Array:
    """Cut a polygon [K, 3] at the camera's near plane; may return fewer than three points."""
    depth = (contour - camera.eye) @ camera.rotation[2] - 2 * NEAR
    if depth.min() >= 0:
        return contour
    kept = []
    for i in range(len(contour)):
        j = (i + 1) % len(contour)
        if depth[i] >= 0:
            kept.append(contour[i])
        if (depth[i] >= 0) != (depth[j] >= 0):
            t = depth[i] / (depth[i] - depth[j])
            kept.append(contour[i] + t * (contour[j] - contour[i]))
    return np.array(kept).reshape(-1, 3)


def fixed(pixels: Array) -> NDArray[np.int32]:
    """Pixels to OpenCV's fixed-point polygon coordinates."""
    limit = 2.0**14  # far outside any canvas, far inside int32
    scaled = np.minimum(np.maximum(pixels, -limit), limit) * (1 << SUBPIXEL)
    points: NDArray[np.int32] = scaled.astype(np.int32)
    return points
