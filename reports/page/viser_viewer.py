"""Splats, cameras and photos in viser's viewer, which runs in any browser.

viser is the extra ``view``; it is imported when a viewer is asked for. Splats are shown with the
constant term of their colour, as viser draws them.
"""

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from mattgs_ops.capture.scene import Scene, View
from mattgs_ops.errors import InputError
from reports.page.splat_view import LEAST_ALPHA, nearest_point

PHOTO_WIDTH = 240  # pixels of a photo in its frustum
FRUSTUM_SHARE = 0.06  # length of a frustum, of the cameras' distance from what they look at
STEP_BACK = 1.6  # of the first camera's distance, and higher: its photo must not hide the splats
LINE = 1.5  # pixels
COLOURS = {"train": (90, 110, 130), "test": (213, 94, 0)}


def require() -> None:
    """Raise :class:`InputError` that says what to install when viser is missing."""
    if importlib.util.find_spec("viser") is None:
        raise InputError(
            "`mattgs view` needs viser, which is not installed: pip install 'mattgs-bench[view]'"
        )


def serve(splats: Path, scene: Scene | None, photos: Mapping[str, Path], port: int) -> Any:
    """Start viser's server on this machine and return it; it runs in threads of its own.

    ``photos`` maps names of views to pictures. Raises :class:`InputError` for a file without
    splats.
    """
    import viser

    from mattgs_ops.splat.files.activated import activated
    from mattgs_ops.splat.files.ply import read_ply

    cloud = activated(read_ply(splats))
    cloud = cloud.take(np.flatnonzero(cloud.alpha >= LEAST_ALPHA))
    if not len(cloud.means):
        raise InputError(f"{splats}: expected at least one visible splat, found none")
    turn = Rotation.from_quat(cloud.quaternions, scalar_first=True).as_matrix()
    stretched = turn * np.exp(cloud.log_scales)[:, None, :]  # [N, 3, 3]: columns are the axes
    server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    server.scene.add_gaussian_splats(
        "/splats",
        centers=cloud.means.astype(np.float32),
        covariances=(stretched @ stretched.transpose(0, 2, 1)).astype(np.float32),
        rgbs=np.clip(cloud.colour, 0, 1).astype(np.float32),
        opacities=cloud.alpha[:, None].astype(np.float32),
    )
    if scene is not None:
        _add_cameras(server, scene, photos)
    return server


def _add_cameras(server: Any, scene: Scene, photos: Mapping[str, Path]) -> None:
    """Add a frustum for each registered view; a click on one looks through it."""
    views = [view for view in scene.views if view.camera is not None]
    cameras = [view.camera for view in views if view.camera is not None]
    if not cameras:
        return
    centres = np.stack([camera.centre for camera in cameras])
    target = nearest_point(centres, np.stack([camera.rotation[2] for camera in cameras]))
    length = FRUSTUM_SHARE * float(np.linalg.norm(centres - target, axis=1).mean())
    up = -np.stack([camera.rotation[1] for camera in cameras]).mean(axis=0)
    up /= np.linalg.norm(up)
    server.scene.set_up_direction(tuple(up))
    back = STEP_BACK * (centres[0] - target)
    server.initial_camera.position = tuple(target + back + up * np.linalg.norm(back) / 3)
    server.initial_camera.look_at = tuple(target)
    for view in views:
        _add_camera(server, view, photos.get(view.name), length)


def _add_camera(server: Any, view: View, photo: Path | None, length: float) -> None:
    camera = view.camera
    if camera is None:
        return
    inner = camera.intrinsics
    frustum = server.scene.add_camera_frustum(
        f"/cameras/{view.split}/{view.name}",
        fov=2 * float(np.arctan(inner.height / 2 / inner.fy)),
        aspect=inner.width / inner.height,
        scale=length,
        thickness=LINE,
        thickness_units="screen",
        color=COLOURS[view.split],
        image=None if photo is None else _small(photo),
        wxyz=tuple(Rotation.from_matrix(camera.rotation.T).as_quat(scalar_first=True)),
        position=tuple(camera.centre),
    )

    def look_through(event: Any) -> None:
        event.client.camera.wxyz = frustum.wxyz
        event.client.camera.position = frustum.position

    frustum.on_click(look_through)


def _small(path: Path) -> np.ndarray[Any, np.dtype[np.uint8]]:
    with Image.open(path) as image:
        picture = image.convert("RGB")
        picture.thumbnail((PHOTO_WIDTH, PHOTO_WIDTH))
        return np.asarray(picture, dtype=np.uint8)
