"""Frames of a video as photos: as many as asked for, evenly spaced, the sharp ones."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from mattgs_ops.capture.prepare import prepare
from mattgs_ops.capture.video import extract_frames, relative_sharpness, sharpness
from mattgs_ops.config import CaptureConfig
from mattgs_ops.errors import InputError

WIDTH, HEIGHT = 96, 64


def write_video(path: Path, frames: int, sharp: set[int]) -> Path:
    """Write noise, blurred but for the frames in ``sharp``."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 24, (WIDTH, HEIGHT))
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for index in range(frames):
        writer.write(noise if index in sharp else cv2.GaussianBlur(noise, (0, 0), 3))
    writer.release()
    return path


def numbers(paths: list[Path]) -> list[int]:
    return [int(path.stem.removeprefix("frame_")) for path in paths]


def test_the_sharpest_frame_of_each_stretch_is_kept(tmp_path: Path) -> None:
    sharp = {5, 14, 27, 33}  # one in the middle half of each stretch of ten
    video = write_video(tmp_path / "walk.avi", 40, sharp)
    written = extract_frames(video, tmp_path / "frames", 4)
    assert numbers(written) == sorted(sharp)
    with Image.open(written[0]) as frame:
        assert frame.size == (WIDTH, HEIGHT)


def test_a_sharp_frame_at_the_edge_of_a_stretch_is_too_near_the_next(tmp_path: Path) -> None:
    video = write_video(tmp_path / "walk.avi", 40, {9, 10})
    found = numbers(extract_frames(video, tmp_path / "frames", 4))
    assert not {9, 10} & set(found)
    assert min(np.diff(found)) >= 5


def test_a_short_video_gives_every_frame(tmp_path: Path) -> None:
    video = write_video(tmp_path / "walk.avi", 5, {1})
    assert numbers(extract_frames(video, tmp_path / "frames", 60)) == [0, 1, 2, 3, 4]


def test_colours_are_those_of_the_video(tmp_path: Path) -> None:
    path = tmp_path / "red.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 24, (WIDTH, HEIGHT))
    for _ in range(4):
        writer.write(np.full((HEIGHT, WIDTH, 3), (10, 40, 220), dtype=np.uint8))  # BGR
    writer.release()
    with Image.open(extract_frames(path, tmp_path / "frames", 2)[0]) as frame:
        assert np.abs(np.asarray(frame).mean(axis=(0, 1)) - [220, 40, 10]).max() < 12


def test_sharpness_falls_with_blur() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (900, 1600, 3), dtype=np.uint8)
    assert sharpness(noise) > 5 * sharpness(cv2.GaussianBlur(noise, (0, 0), 4))


def test_relative_sharpness_falls_with_blur_and_not_with_exposure() -> None:
    coarse = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    photo = np.asarray(cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_NEAREST), np.uint8)
    dark = np.rint(photo * 0.3).astype(np.uint8)
    assert sharpness(dark) < 0.1 * sharpness(photo)
    assert relative_sharpness(dark) == pytest.approx(relative_sharpness(photo), rel=0.02)
    blurred = cv2.GaussianBlur(photo, (0, 0), 3)
    assert relative_sharpness(blurred) < 0.25 * relative_sharpness(photo)
    assert relative_sharpness(np.full((240, 320, 3), 90, np.uint8)) == 0


def test_a_frame_of_noise_in_the_dark_is_not_the_sharpest(tmp_path: Path) -> None:
    rng, path = np.random.default_rng(0), tmp_path / "walk.avi"
    codec = cv2.VideoWriter.fourcc(*"FFV1")  # lossless, so that the noise stays
    writer = cv2.VideoWriter(str(path), codec, 24, (WIDTH, HEIGHT))
    thing = cv2.resize(rng.integers(0, 256, (8, 12, 3), dtype=np.uint8), (WIDTH, HEIGHT))
    for index in range(20):
        black = rng.integers(0, 3, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        writer.write(black if index in (8, 12) else thing)
    writer.release()
    assert not {8, 12} & set(numbers(extract_frames(path, tmp_path / "frames", 1)))


@pytest.mark.parametrize("content", [None, b"no video at all"])
def test_what_is_no_video_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "walk.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"walk\.mp4: (expected|cannot be read as) a video"):
        extract_frames(path, tmp_path / "frames", 4)


def test_a_video_becomes_a_capture(tmp_path: Path) -> None:
    video = write_video(tmp_path / "walk.avi", 40, set(range(40)))
    capture = prepare(
        CaptureConfig(name="walk", path=video, frames=8), tmp_path / "out", test_every=4
    )
    assert [view.split for view in capture.views] == ["test", "train", "train", "train"] * 2
    assert all(view.name.startswith("frame_") for view in capture.views)
