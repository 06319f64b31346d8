"""A capture small enough for tests: a box with printed sides on a printed table, ray-cast."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mattgs_ops import sfm
from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import PreparedCapture, Scene, Split, View
from mattgs_ops.config import SfmConfig

VIEWS, WIDTH, HEIGHT, FOCAL = 9, 240, 180, 260.0
HALF = np.array([0.5, 0.4, 0.35])  # the box's half extents; it stands on the table z = 0
STEP = np.radians(10)
CONFIG = SfmConfig()


def print_texture(rng: np.random.Generator, size: int, blobs: int) -> NDArray[np.float32]:
    """Blobs of many sizes and colours: something for SIFT at every scale."""
    image = np.full((size, size, 3), 128, dtype=np.uint8)
    centres = rng.integers(0, size, (blobs, 2)).tolist()
    radii = (size * (0.5 + 3.3 * rng.random(blobs) ** 3) / blobs**0.5).astype(int).tolist()
    for centre, radius, colour in zip(
        centres, radii, rng.integers(0, 256, (blobs, 3)).tolist(), strict=True
    ):
        cv2.circle(image, centre, radius, colour, -1)
    return cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32)


def with_equal_sides(seed: int, blobs: int = 8000) -> list[NDArray[np.float32]]:
    """Print a table, with so many blobs, and a box of whose sides opposite ones look the same."""
    rng = np.random.default_rng(seed)
    table = print_texture(rng, 1024, blobs)
    one, other, top, bottom = (print_texture(rng, 256, 650) for _ in range(4))
    sides = []
    for side, half in ((one, HALF[1]), (other, HALF[0])):
        across = round(2 * half * len(side))  # rows of the print that the side shows
        back = side.copy()
        back[:across] = side[:across][::-1]
        sides += [side, back]
    return [table, *sides, bottom, top]


def orbit(count: int, step: float = STEP) -> list[Camera]:
    cameras = []
    for k in range(count):
        angle = (k - count / 2) * step
        height = 1.3 + 0.25 * np.sin(3 * angle)
        centre = np.array([2.2 * np.cos(angle), 2.2 * np.sin(angle), height])
        forward = np.array([0.0, 0.0, 0.3]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        intrinsics = Intrinsics(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
        cameras.append(Camera(intrinsics, rotation, -rotation @ centre))
    return cameras


def cast(
    camera: Camera, textures: list[NDArray[np.float32]]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the photo [H, W, 3] (BGR) and the box's exact mask [H, W], 2×2 samples a pixel."""
    big = camera.scaled(2 * WIDTH, 2 * HEIGHT)
    i = big.intrinsics
    u, v = np.meshgrid(np.arange(i.width) + 0.5, np.arange(i.height) + 0.5)
    local = np.stack([(u - i.cx) / i.fx, (v - i.cy) / i.fy, np.ones_like(u)], axis=-1)
    rays, origin = local @ big.rotation, big.centre
    image = np.full((*u.shape, 3), 200, dtype=np.float32)
    nearest = np.full(u.shape, np.inf)
    mask = np.zeros(u.shape, dtype=np.uint8)
    centre = np.array([0, 0, HALF[2]])
    faces: list[tuple[int, float, np.ndarray | None]] = [(2, 0.0, None)]
    faces += [(a, centre[a] + s * HALF[a], HALF) for a in range(3) for s in (-1, 1)]
    for texture, (axis, level, half) in zip(textures, faces, strict=True):
        middle = np.zeros(3) if half is None else centre
        if half is not None and (origin[axis] - level) * (level - centre[axis]) <= 0:
            continue  # the box itself hides this side
        extent = np.full(3, 2.5) if half is None else half
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (level - origin[axis]) / rays[..., axis]
        ok = (distance > 0) & (distance < nearest)
        others = [a for a in range(3) if a != axis]
        hit = [origin[a] + distance[ok] * rays[..., a][ok] - middle[a] for a in others]
        here = np.logical_and(*(np.abs(h) <= extent[a] for h, a in zip(hit, others, strict=True)))
        ok[ok] = here
        scale = texture.shape[0] / (5.0 if half is None else 1.0)
        rows, columns = (
            np.clip((h[here] + extent[a]) * scale, 0, texture.shape[0] - 1).astype(int)
            for h, a in zip(hit, others, strict=True)
        )
        image[ok] = texture[rows, columns]
        nearest[ok] = distance[ok]
        mask[ok] = 0 if half is None else 255
    small = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    share = cv2.resize(mask, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.rint(small).astype(np.uint8), np.where(share >= 128, 255, 0).astype(np.uint8)


@pytest.fixture(scope="session")
def box_capture(tmp_path_factory: pytest.TempPathFactory) -> PreparedCapture:
    """Nine views of the box, their exact masks and poses (``truth``)."""
    return photographed(tmp_path_factory.mktemp("box"), seed=7)


def photographed(folder: Path, seed: int) -> PreparedCapture:
    """Print the box and its table anew and photograph them from nine places."""
    rng = np.random.default_rng(seed)
    textures = [print_texture(rng, 1024, 8000), *(print_texture(rng, 256, 650) for _ in range(6))]
    return photographed_by(folder, textures, orbit(VIEWS))


def photographed_by(
    folder: Path, textures: list[NDArray[np.float32]], cameras: list[Camera]
) -> PreparedCapture:
    """Photograph a table and a box, whose six sides have the other textures."""
    (folder / "photos").mkdir(parents=True)
    (folder / "masks").mkdir()
    views = []
    for k, camera in enumerate(cameras):
        name = f"{k:04d}.jpg"
        photo, mask = folder / "photos" / f"{name}.png", folder / "masks" / f"{name}.png"
        image, cut = cast(camera, textures)
        cv2.imwrite(str(photo), image)
        cv2.imwrite(str(mask), cut)
        split: Split = "test" if k % 8 == 0 else "train"
        views.append(View(name, split, WIDTH, HEIGHT, photo, mask, camera))
    capture = PreparedCapture("box", folder, tuple(views), "truth", "truth")
    capture.save()
    return capture


@pytest.fixture
def copied(box_capture: PreparedCapture, tmp_path: Path) -> Callable[..., PreparedCapture]:
    """Copy the capture for a test that damages it, with other words about its origin."""

    def copy(**changes: object) -> PreparedCapture:
        folder = tmp_path / "copy"
        shutil.copytree(box_capture.folder, folder)
        return replace(PreparedCapture.load(folder), **changes)  # type: ignore[arg-type]

    return copy


@pytest.fixture(scope="session")
def box_scene(box_capture: PreparedCapture, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Reconstruct the box once, by the default mode."""
    out = tmp_path_factory.mktemp("scene")
    return sfm.reconstruct(box_capture, box_capture.folder / "masks", CONFIG, out)
