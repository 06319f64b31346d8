"""Specification of the search for the lens's axis in cropped photos, in a process of its own."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap.job import JobView
from mattgs_ops.sfm.colmap.lenses.build import build_cameras
from mattgs_ops.sfm.colmap.lenses.cropped import images_of_their_own_size
from mattgs_ops.sfm.colmap.mapping import with_poses

MAP_AND_ADJUST = """
import json, sys
import numpy as np
import pycolmap
from mattgs_ops.sfm.colmap import mapping
from mattgs_ops.sfm.colmap.job import JobView

ZOOM, CUT, PART, LAST = 1.5, np.array([220.0, 10.0]), (800, 700), 12
database = sys.argv[1]
pycolmap.set_random_seed(0)
options = pycolmap.SyntheticDatasetOptions()
options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, LAST, 200
with pycolmap.Database.open(database) as opened:
    truth = pycolmap.synthesize_dataset(options, opened)
(lens,) = truth.cameras.values()
cameras = {
    number: pycolmap.Camera.create_from_model_name(number, "SIMPLE_RADIAL", focal, *size)
    for number, focal, size in [
        (1, lens.focal_length, (lens.width, lens.height)),  # took all photos but two
        (2, lens.focal_length * ZOOM, (lens.width + 1, lens.height)),  # another one
        (3, lens.focal_length * 0.8, PART),  # the first one's photo, cropped, and a wrong guess
    ]
}
model, rng = pycolmap.Reconstruction(), np.random.default_rng(0)
for camera in cameras.values():
    camera.params = [*camera.params[:3], 0.0]
    model.add_camera_with_trivial_rig(camera)
numbers = sorted(truth.reg_image_ids())
of_image = {number: cameras[max(1, place - LAST + 3 + 1)] for place, number in enumerate(numbers)}
for number in numbers:
    image, camera = truth.image(number), of_image[number]
    xy = np.array([point.xy for point in image.points2D])
    if camera is cameras[2]:
        xy = (xy - [lens.width / 2, lens.height / 2]) * ZOOM + [camera.width / 2, lens.height / 2]
    if camera is cameras[3]:
        xy -= CUT
    copy = pycolmap.Image(
        name=image.name,
        keypoints=xy + rng.normal(0, 0.3, xy.shape),
        camera_id=camera.camera_id,
        image_id=number,
    )
    model.add_image_with_trivial_frame(copy, image.cam_from_world())
for point in truth.points3D.values():
    model.add_point3D(point.xyz, point.track)
views = [
    JobView(str(n), "", "", of_image[n].width, of_image[n].height, None, None) for n in numbers
]
moved = [n - 1 for n in mapping.adjust(model, views, database, intrinsics_known=False)]
similarity = pycolmap.align_reconstructions_via_proj_centers(model, truth, 1.0)
model.transform(similarity)
away = [
    float(np.linalg.norm(model.image(n).projection_center() - truth.image(n).projection_center()))
    for n in numbers
]
lenses = [[*map(float, model.camera(n).params)] for n in cameras]
expected = [lens.focal_length, *(np.array([lens.width, lens.height]) / 2 - CUT)]
print(json.dumps([moved, lenses, expected, away]))
"""


def view(width: int, height: int, taken: tuple[int, int] | None = None, **told: Any) -> JobView:
    pose = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return JobView("a.jpg", "a.png", "a.png", width, height, told.get("known"), pose, taken=taken)


def test_sizes_count_as_photos_were_taken_either_way_up() -> None:
    known = (1.0, 1.0, 1.0, 1.0)
    views = [
        view(40, 30),
        view(30, 40),
        view(40, 20),
        view(40, 30, taken=(80, 60)),
        view(40, 20, taken=(40, 20), known=known),
        view(50, 20, known=known),
    ]
    model = with_poses(views, build_cameras(views, SfmConfig()))
    assert [number - 1 for number in images_of_their_own_size(model, views)] == [3]


def test_a_cropped_photo_gets_the_others_lens_and_an_axis_of_its_own(tmp_path: Path) -> None:
    """The photo of another lens keeps its own, and its axis in the middle."""
    command = [sys.executable, "-c", MAP_AND_ADJUST, str(tmp_path / "database.db")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    moved, (main, other, cropped), expected, away = json.loads(done.stdout.splitlines()[-1])
    assert moved == [11]
    assert abs(cropped[0] / main[0] - 1) < 0.001  # the same, until all was adjusted once more
    assert max(abs(a - b) for a, b in zip(cropped[:3], expected, strict=True)) < 3
    assert abs(other[0] / main[0] - 1.5) < 0.01
    assert max(away) < 0.02
