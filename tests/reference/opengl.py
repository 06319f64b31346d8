"""OpenGL's camera-to-world matrices, the way from a camera: x right, y up, z back."""

import numpy as np
from numpy.typing import NDArray


def to_opengl(
    rotation: NDArray[np.float64], translation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn world-to-camera R [3, 3] and t [3] (x right, y down, z forward) into a matrix [4, 4]."""
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = rotation, translation
    return np.asarray(np.linalg.inv(world_to_camera) @ np.diag([1.0, -1, -1, 1]), np.float64)
