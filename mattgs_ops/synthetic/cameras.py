"""Hand-held orbits: where the photos are taken from."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from mattgs_ops.capture.camera import Camera, Intrinsics, from_opengl
from mattgs_ops.synthetic.surfaces.mesh import Array

FOCAL = 600 / 640  # focal length over the photo's width, about a telephone's main lens


@dataclass(frozen=True)
class Orbit:
    """One walk around the object: elevation in degrees, distance in centimetres, share of views."""

    elevation: float
    distance: float
    share: float


def intrinsics(width: int, height: int) -> Intrinsics:
    """Return the pinhole of every view: square pixels, principal point in the middle."""
    return Intrinsics(width, height, FOCAL * width, FOCAL * width, width / 2, height / 2)


def look_at(eye: Array, target: Array, roll: float) -> Array:
    """Return an OpenGL camera-to-world matrix [4, 4]; ``roll`` in degrees, world up is z."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2] = c * right + s * up, c * up - s * right, back
    out[:3, 3] = eye
    return out


def walk(orbits: tuple[Orbit, ...], target: Array, views: int, rng: Generator) -> list[Array]:
    """Return ``views`` camera-to-world matrices [4, 4] (OpenGL) along the orbits, in order.

    Each step strays as a hand does: about 2° around, 2° up, 5 % in distance, 2 % of the distance
    in aim, 2.5° of roll.
    """
    shares = np.array([orbit.share for orbit in orbits])
    ends = np.round(np.cumsum(shares) / shares.sum() * views).astype(int)
    poses = []
    for orbit, first, last in zip(orbits, [0, *ends[:-1]], ends, strict=True):
        start = rng.uniform(0, 2 * np.pi)
        for k in range(last - first):
            around = start + 2 * np.pi * k / (last - first) + np.radians(rng.normal(0, 2))
            rise = np.radians(orbit.elevation + np.clip(rng.normal(0, 2), -4, 4))
            far = orbit.distance * (1 + np.clip(rng.normal(0, 0.05), -0.1, 0.1))
            ray = [np.cos(around) * np.cos(rise), np.sin(around) * np.cos(rise), np.sin(rise)]
            aim = target + np.clip(rng.normal(0, 0.02, 3), -0.035, 0.035) * orbit.distance
            poses.append(look_at(target + far * np.array(ray), aim, float(rng.normal(0, 2.5))))
    return poses


def camera(camera_to_world: Array, width: int, height: int) -> Camera:
    """Return the project's camera of an OpenGL camera-to-world matrix [4, 4]."""
    return Camera(intrinsics(width, height), *from_opengl(camera_to_world))
