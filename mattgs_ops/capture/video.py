"""A video as photos: sharp frames, evenly spaced.

The video is cut into as many stretches of equal length as photos are wanted. Of each stretch's
middle half the sharpest frame is kept, so that two photos are never closer than half a stretch.
Sharpness is the variance of the Laplacian (Pech-Pacheco et al. 2000) of the frame reduced to a
common width, so that it tells motion blur, not sensor noise. OpenCV decodes, which comes with its
own FFmpeg, and turns frames upright as the file says.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.photos import write_png
from mattgs_ops.errors import InputError
from mattgs_ops.progress import Progress, no_progress

VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm"})
SHARPNESS_WIDTH = 640  # pixels
MIDDLE_HALF = (0.25, 0.75)  # of a stretch

Frame = NDArray[np.uint8]


def extract_frames(
    video: Path, folder: Path, count: int, progress: Progress = no_progress
) -> list[Path]:
    """Write ``count`` frames of ``video`` to ``folder`` as ``frame_NNNNNN.png``, by frame number.

    Fewer come out of a video that has fewer frames. Raises :class:`InputError` when the file is
    missing or no video.
    """
    if not video.is_file():
        found_instead = "a folder" if video.is_dir() else "nothing"
        raise InputError(f"{video}: expected a video, found {found_instead}")
    total = _frames_in(video)
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    best: tuple[float, int, Frame] | None = None
    stretch = 0
    capture = cv2.VideoCapture(str(video))
    for index in range(total):
        read, frame = capture.read()
        if not read:
            break
        now = index * count // total
        if now != stretch and best is not None:
            written.append(_write(folder, best[1], best[2]))
            best = None
        stretch = now
        place = (index + 0.5) * count / total - now  # in [0, 1] of its stretch
        middle = MIDDLE_HALF[0] <= place <= MIDDLE_HALF[1] or total < 4 * count
        found = sharpness(frame) if middle else -1.0
        if middle and (best is None or found > best[0]):
            best = (found, index, np.asarray(frame, dtype=np.uint8))
        progress(index + 1, total, f"{len(written)} of {count} frames chosen")
    capture.release()
    if best is not None:
        written.append(_write(folder, best[1], best[2]))
    return written


def sharpness(frame: Frame) -> float:
    """Return how sharp a frame [H, W, 3] is: the variance of its Laplacian at a common width.

    It grows with the square of exposure and contrast: for frames of one moment, exposed alike.
    """
    return float(cv2.Laplacian(_reduced(frame), cv2.CV_64F).var())


def relative_sharpness(photo: Frame) -> float:
    """Return the sharpness of a photo [H, W, 3] by its own contrast, the variance of its greys.

    Darkening changes both alike. It is for photos that were exposed apart; among frames of a video
    the sharpest would be a black one, of which noise is all the contrast.
    """
    contrast = float(_reduced(photo).var())
    return sharpness(photo) / contrast if contrast else 0.0


def _reduced(frame: Frame) -> NDArray[np.uint8]:
    """Return a frame's greys [H, W] at the common width."""
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    if width > SHARPNESS_WIDTH:
        size = (SHARPNESS_WIDTH, max(1, round(height * SHARPNESS_WIDTH / width)))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(grey, dtype=np.uint8)


def _frames_in(video: Path) -> int:
    """Count the frames; what a file says of itself is often wrong by some."""
    capture = cv2.VideoCapture(str(video))
    count = 0
    while capture.grab():
        count += 1
    capture.release()
    if not count:
        raise InputError(
            f"{video}: cannot be read as a video; convert it to MP4 with H.264, or extract photos"
        )
    return count


def _write(folder: Path, index: int, frame: Frame) -> Path:
    path = folder / f"frame_{index:06}.png"
    write_png(path, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
    return path
