"""Which views share a camera, and which focal lengths a camera may have."""

from dataclasses import replace

import pycolmap

from mattgs_ops.capture.formats.exif import FOCAL_SHARES
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap.job import JobView
from mattgs_ops.sfm.colmap.lenses.build import FOCAL_GUESS, build_cameras


def view(focal: float | None, lens: str, width: int = 40, height: int = 30) -> JobView:
    return JobView("a.jpg", "a.png", "a.png", width, height, None, None, focal, lens)


def test_photos_of_one_size_share_a_camera_where_exif_names_one_lens() -> None:
    views = [
        view(None, ""),
        view(None, ""),
        view(None, "", 30, 40),
        view(None, "Camera 1 55.0 mm"),
        view(None, "Camera 1 18.0 mm"),
        view(None, "Camera 1 55.0 mm"),
        view(50.0, "Camera 2"),
        view(50.0, "Camera 3"),
    ]
    cameras = build_cameras(views, SfmConfig())
    assert [camera.camera_id for camera in cameras] == [1, 1, 2, 3, 4, 3, 5, 6]
    assert cameras[0].focal_length == FOCAL_GUESS * 40
    assert cameras[6].focal_length == 50


def test_photos_that_were_reduced_share_a_camera_where_they_were_taken_in_one_size() -> None:
    whole = replace(view(None, ""), taken=(400, 300))
    cut = replace(view(None, ""), taken=(320, 240))
    cameras = build_cameras([whole, cut, whole], SfmConfig())
    assert [camera.camera_id for camera in cameras] == [1, 2, 1]


def test_a_focal_length_by_exif_keeps_to_colmap_s_own_bounds() -> None:
    options = pycolmap.IncrementalPipelineOptions()
    assert (options.min_focal_length_ratio, options.max_focal_length_ratio) == FOCAL_SHARES
