"""What an attempt leaves beside its model: key points and the verified matches between them."""

import numpy as np

from mattgs_ops.capture.scene import Scene
from mattgs_ops.sfm.colmap.moving_object import epipolar_error


def test_matches_of_whole_photos_are_kept_as_rows_of_their_key_points(box_scene: Scene) -> None:
    """Each pair's matched pixels lie on the epipolar lines of the scene's own cameras."""
    data = np.load(box_scene.folder / "keypoints.npz")
    assert len(data["matches"]) == data["pair_counts"].sum() == box_scene.extra["matches"]["whole"]
    starts = np.cumsum(data["counts"]) - data["counts"]
    cameras = {view.name: view.camera for view in box_scene.views}
    ends = np.cumsum(data["pair_counts"])
    for pair, end, count in zip(data["pairs"], ends, data["pair_counts"], strict=True):
        posed, rays = [], []
        for side, view in enumerate(pair):
            camera = cameras[str(data["names"][view])]
            assert camera is not None
            i = camera.intrinsics
            xy = data["xy"][starts[view] + data["matches"][end - count : end, side]]
            posed.append(camera)
            rays.append((xy - [i.cx, i.cy]) / [i.fx, i.fy])
        assert np.median(epipolar_error(posed[0], posed[1], rays[0], rays[1])) < 1.0
