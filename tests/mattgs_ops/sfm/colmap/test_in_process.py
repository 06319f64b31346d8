"""Specification of what runs inside COLMAP's process, tried in such a process."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm import pipeline

Climbed = dict[str, Any]

EXTRACT_AND_MATCH = """
import hashlib, json, sys
from pathlib import Path
import numpy as np
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap import features, matching
from mattgs_ops.sfm.colmap.job import Job
from mattgs_ops.sfm.colmap.lenses.build import build_cameras

job, thorough, counts_of_threads = json.loads(sys.argv[1])
views, config = Job.load(Path(job)).views, SfmConfig()

def extracted_and_matched(threads):
    notes = []
    how = features.Extraction(0.02 / 3, 0.0, thorough)
    found = features.extract(views, config, how, threads, lambda *n: notes.append(n))
    pairs = matching.match_and_verify(
        matching.exhaustive(len(views)),
        [f.descriptors for f in found],
        [np.arange(len(f.inside)) for f in found],
        [f.positions for f in found],
        [f.inside for f in found],
        build_cameras(views, config),
        0,
        threads,
        lambda *n: notes.append(n),
    )
    digest = hashlib.sha256()
    for f in found:
        for array in (f.keypoints, f.descriptors, f.inside, f.whole, f.masked):
            digest.update(array.tobytes())
    for pair, verified in pairs.items():
        digest.update(repr(pair).encode() + verified.matches.tobytes())
    counts = [len(f.inside) for f in found]
    return [digest.hexdigest(), counts, len(pairs), notes]

print(json.dumps([extracted_and_matched(threads) for threads in counts_of_threads]))
"""

TILTED = """
import json, sys
from pathlib import Path
import cv2
import numpy as np
from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap import features, matching
from mattgs_ops.sfm.colmap.job import JobView

folder = Path(json.loads(sys.argv[1])[0])
rng = np.random.default_rng(0)
picture = np.zeros((480, 640), np.float32)
for cells in (8, 16, 32, 64, 128):
    grid = rng.random((cells, cells), dtype=np.float32)
    picture += cv2.resize(grid, (640, 480), interpolation=cv2.INTER_CUBIC)
picture = cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
narrow = np.cos(np.radians(60))  # the picture seen from 60 degrees to the side, from far away
seen = cv2.resize(picture, (int(640 * narrow), 480), interpolation=cv2.INTER_AREA)
views = []
for name, image in (("straight", picture), ("aslant", seen)):
    photo, mask = folder / f"{name}.png", folder / f"{name}-mask.png"
    cv2.imwrite(str(photo), image)
    cv2.imwrite(str(mask), np.full(image.shape, 255, np.uint8))
    height, width = image.shape
    views.append(JobView(name, str(photo), str(mask), width, height, None, None))

def matched(thorough):
    how = features.Extraction(0.02 / 3, 0.0, thorough)
    found = [
        features.extract((view,), SfmConfig(), how, 1, lambda *note: None)[0] for view in views
    ]
    pairs = matching.match(found[0].descriptors, found[1].descriptors)
    expected = found[0].positions[pairs[:, 0]] * [narrow, 1]
    away = np.linalg.norm(expected - found[1].positions[pairs[:, 1]], axis=1)
    return [int((away < 2).sum()), len(away)]

print(json.dumps([matched(thorough) for thorough in (False, True)]))
"""

ADJUST = """
import json, sys
import numpy as np
import pycolmap
from mattgs_ops.sfm.colmap import mapping

pycolmap.set_random_seed(0)
options = pycolmap.SyntheticDatasetOptions()
options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 12, 200
truth = pycolmap.synthesize_dataset(options)
model = pycolmap.Reconstruction(truth)
noise = pycolmap.SyntheticNoiseOptions()
noise.point2D_stddev = 0.3
pycolmap.synthesize_noise(noise, model)
rng = np.random.default_rng(0)
for number in model.reg_image_ids():  # one observation in ten is wrong by up to four pixels
    for point in model.image(number).points2D:
        if rng.random() < 0.1:
            point.xy = point.xy + rng.uniform(-4, 4, 2)

def error(found):
    similarity = pycolmap.align_reconstructions_via_proj_centers(found, truth, 1.0)
    found = pycolmap.Reconstruction(found)
    found.transform(similarity)
    centres = [
        found.image(n).projection_center() - truth.image(n).projection_center()
        for n in found.reg_image_ids()
    ]
    return float(np.linalg.norm(centres, axis=1).mean())

plain = pycolmap.Reconstruction(model)
pycolmap.bundle_adjustment(plain)
before = [camera.params.tolist() for camera in model.cameras.values()]
results = []
for known in (False, True, True):
    mine = pycolmap.Reconstruction(model)
    mapping.adjust(mine, (), "", intrinsics_known=known)
    kept = [camera.params.tolist() for camera in mine.cameras.values()] == before
    results.append([error(mine), kept])
print(json.dumps([error(plain), results]))
"""

LADDERS = """
import json, sys
from dataclasses import replace
from pathlib import Path
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.sfm.colmap import attempts
from mattgs_ops.sfm.colmap.job import Job

path, cases = json.loads(sys.argv[1])

def climbed(registers, focal):
    job, tried = Job.load(Path(path)), []
    if focal:
        job = replace(job, views=tuple(replace(view, focal=focal) for view in job.views))

    def attempt(state, better_than=None):  # one that places as many views as it is told
        count = registers[len(tried)]
        tried.append([state.config.max_features, state.config.matcher, state.thorough])
        tried[-1] += [view.focal for view in state.job.views[:1] if focal]
        if not count:
            raise StageError(f"attempt {len(tried)} placed no view")
        state.answer.registered = [view.name for view in job.views[:count]]

    attempts.attempt = attempt
    try:
        found = attempts.run(job, lambda *told: None)
        return [tried, len(found.registered), found.fallbacks]
    except StageError as error:
        return [tried, 0, str(error)]

print(json.dumps([climbed(*case) for case in cases]))
"""


def answer(program: str, *arguments: object) -> Any:
    """Run a program in a fresh process; returns what its last line of output holds."""
    command = [sys.executable, "-c", program, json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("thorough", [False, True], ids=["opencv", "colmap"])
def test_key_points_and_matches_do_not_depend_on_the_number_of_threads(
    box_capture: PreparedCapture, tmp_path: Path, thorough: bool
) -> None:
    job = pipeline._job(box_capture, box_capture.folder / "masks", SfmConfig(), tmp_path, 1).save()
    one, three = answer(EXTRACT_AND_MATCH, str(job), thorough, (1, 3))
    assert one == three
    _, counts, pairs, notes = one
    assert min(counts) > 200
    assert pairs > 10
    assert len(notes) == 9 + 36


def test_the_last_attempt_matches_what_is_seen_aslant(tmp_path: Path) -> None:
    (usual, _), (last, matched) = answer(TILTED, str(tmp_path))
    assert last > 3 * usual
    assert last > 100
    assert last > 0.9 * matched


def test_the_robust_adjustment_is_closer_than_least_squares_and_repeats() -> None:
    plain, (free, *fixed) = answer(ADJUST)
    assert free[0] < 0.7 * plain
    assert [kept for _, kept in (free, *fixed)] == [False, True, True]
    assert fixed[0] == fixed[1]


USUAL, MORE, FAINT = [2048, "auto", False], [8192, "exhaustive", False], [8192, "exhaustive", True]


@pytest.fixture(scope="module")
def climbed(box_capture: PreparedCapture, tmp_path_factory: pytest.TempPathFactory) -> Climbed:
    """Return what attempts that place so many views lead to; one process answers for all tests."""
    folder, masks = tmp_path_factory.mktemp("ladders"), box_capture.folder / "masks"
    job = pipeline._job(box_capture, masks, SfmConfig(), folder, 1).save()
    found = answer(LADDERS, str(job), CASES)
    return dict(zip(map(str, CASES), found, strict=True))


LADDER_CASES: list[tuple[list[int], list[list[object]], int]] = [
    ([9], [USUAL], 9),
    ([8, 9], [USUAL, MORE], 9),  # 8 of 9 views are fewer than 95 %
    ([5, 7, 9], [USUAL, MORE, FAINT], 9),
    ([5, 7, 6], [USUAL, MORE, FAINT], 7),
    ([0, 0, 4], [USUAL, MORE, FAINT], 4),
    ([4, 0, 0], [USUAL, MORE, FAINT], 4),
]
NOWHERE, OF_EXIF = [0, 0, 0], ([9], [2, 0, 5], [2, 0, 2, 9], [0, 0, 0, 0])
FOCAL = 1500.0
CASES = [
    *([registers, None] for registers in (*(case[0] for case in LADDER_CASES), NOWHERE)),
    *([registers, FOCAL] for registers in OF_EXIF),
]


@pytest.mark.parametrize(("registers", "tried", "best"), LADDER_CASES)
def test_further_attempts_follow_while_views_are_missing_and_the_best_counts(
    climbed: Climbed, registers: list[int], tried: list[list[object]], best: int
) -> None:
    found = climbed[str([registers, None])]
    assert found[:2] == [tried, best]
    steps = [
        f"{max(registers[:k])} of 9 views registered: {what}"
        for k, what in enumerate(
            (
                "up to 8,192 key points kept, all pairs compared",
                "fainter key points of affine shapes sought by COLMAP's SIFT, up to 8,192 kept",
            )[: len(tried) - 1],
            start=1,
        )
    ]
    useless = "no more views registered that way; not used"
    assert [step for step in found[2] if step != useless] == steps
    gains = [n > max([0, *registers[:k]]) for k, n in enumerate(registers)]
    assert found[2].count(useless) == gains[1:].count(False)


def test_no_attempt_that_places_views_is_a_failure_of_the_last(climbed: Climbed) -> None:
    tried, placed, message = climbed[str([NOWHERE, None])]
    assert (len(tried), placed, message) == (3, 0, "attempt 3 placed no view")


def test_a_focal_length_by_exif_that_places_too_few_views_is_left_aside_at_last(
    climbed: Climbed,
) -> None:
    placed_all, placed_half, placed_few, placed_none = (
        climbed[str([registers, FOCAL])] for registers in OF_EXIF
    )
    with_it = [[*one, FOCAL] for one in (USUAL, MORE, FAINT)]
    everything = [*with_it, [*FAINT, None]]
    assert placed_all[:2] == [with_it[:1], 9]
    assert placed_half[:2] == [with_it, 5]  # more than half
    tried, placed, steps = placed_few
    assert (tried, placed) == (everything, 9)
    assert steps[-1].startswith("2 of 9 views registered: EXIF's focal length (")
    assert steps[-1].endswith(" left aside, otherwise as before")
    tried, placed, message = placed_none
    assert (tried, placed) == (everything, 0)
    assert message.startswith("attempt 4 placed no view\nall attempts but the last started from")
    assert "EXIF's focal length" in message
