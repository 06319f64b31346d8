"""Structure-from-motion by COLMAP's own defaults beside ours: same photos, same threads.

    python benchmarks/sfm/beside_colmap.py rover fox=../photos/fox --threads 2
    python benchmarks/sfm/beside_colmap.py fox=../photos/fox --only ours --threads 1 2

pycolmap extracts (no masks, photos up to 3,200 pixels by its default), matches all pairs and maps
incrementally with its default options but for the threads; the largest model counts. Ours is
``mattgs_ops.sfm.reconstruct`` with its defaults. Both see the photos as the prepare stage leaves
them. Prints one Markdown row per capture and program; seconds are wall-clock and of processors.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.sfm.modes import prepared
from mattgs_ops import sfm
from mattgs_ops.capture.camera import Camera
from mattgs_ops.capture.formats.colmap_model import read_model
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import InputError
from mattgs_ops.sfm.alignment import pose_error
from mattgs_ops.sfm.assemble import pinhole_conversion

HEADER = (
    "capture", "program", "threads", "registered", "points", "error px", "rotation ° mean / max",
    "position % mean / max", "wall s", "CPU s",
)  # fmt: skip
# COLMAP crashes beside some libraries, and its processor time is to be told apart: its own process
PROGRAM = """
import sys
from pathlib import Path
import pycolmap

photos, out, threads = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
database = out / "database.db"
extraction = pycolmap.FeatureExtractionOptions()
extraction.num_threads, extraction.use_gpu = threads, False
matching = pycolmap.FeatureMatchingOptions()
matching.num_threads, matching.use_gpu = threads, False
pycolmap.extract_features(
    database, photos, camera_mode=pycolmap.CameraMode.SINGLE, extraction_options=extraction
)
pycolmap.match_exhaustive(database, matching_options=matching)
mapping = pycolmap.IncrementalPipelineOptions()
mapping.num_threads = threads
models = pycolmap.incremental_mapping(database, photos, out, mapping)
if models:
    best = max(models.values(), key=lambda model: model.num_reg_images())
    (out / "best").mkdir()
    best.write_binary(out / "best")
    print(best.compute_mean_reprojection_error())
"""


def main() -> None:
    """Parse arguments, run both programs on each capture, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures", nargs="+", help="bundled names, or NAME=FOLDER")
    parser.add_argument("--threads", type=int, nargs="+", default=[1])
    parser.add_argument("--only", choices=("colmap", "ours"))
    arguments = parser.parse_args()
    print("| " + " | ".join(HEADER) + " |")
    print("|" + "---|" * len(HEADER))
    with tempfile.TemporaryDirectory() as scratch:
        for text in arguments.captures:
            capture, masks = prepared(text, Path(scratch))
            for threads in arguments.threads:
                if arguments.only != "ours":
                    print(theirs(capture, Path(scratch), threads), flush=True)
                if arguments.only != "colmap":
                    print(ours(capture, masks, Path(scratch), threads), flush=True)


def theirs(capture: PreparedCapture, scratch: Path, threads: int) -> str:
    """Run pycolmap in a process of its own; returns its row."""
    out = scratch / f"{capture.name}-colmap-{threads}"
    out.mkdir()
    photos = capture.views[0].photo.parent
    command = [sys.executable, "-c", PROGRAM, str(photos), str(out), str(threads)]
    began, used = time.perf_counter(), _children()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began, _children() - used
    if done.returncode:
        raise InputError(f"pycolmap ended with {done.returncode}:\n{done.stderr[-2000:]}")
    if not (out / "best").is_dir():  # no two photos could be placed
        return row(capture, "pycolmap, defaults", threads, {}, 0, float("nan"), seconds)
    error = float(done.stdout.split()[-1])
    model = read_model(out / "best")
    pinholes = {number: pinhole_conversion(c).pinhole for number, c in model.cameras.items()}
    cameras = {
        image.name: Camera(pinholes[image.camera], image.rotation, image.translation)
        for image in model.images.values()
    }
    return row(capture, "pycolmap, defaults", threads, cameras, len(model.xyz), error, seconds)


def ours(capture: PreparedCapture, masks: Path, scratch: Path, threads: int) -> str:
    """Run our stage; returns its row."""
    out = scratch / f"{capture.name}-ours-{threads}"
    began, used = time.perf_counter(), _children() + time.process_time()
    scene = sfm.reconstruct(capture, masks, SfmConfig(), out, threads=threads)
    seconds = time.perf_counter() - began, _children() + time.process_time() - used
    cameras = {v.photo.name: v.camera for v in scene.views if v.camera is not None}
    extra = scene.extra
    error = extra["reprojection_error"]
    return row(capture, "ours", threads, cameras, extra["points"], error, seconds)


def row(
    capture: PreparedCapture,
    program: str,
    threads: int,
    cameras: dict[str, Camera],
    points: int,
    error: float,
    seconds: tuple[float, float],
) -> str:
    """Return a row of the table, with pose errors where the true poses are there."""
    truth = {v.photo.name: v.camera for v in capture.views if v.camera is not None}
    poses = ["", ""]
    if len(set(truth) & set(cameras)) >= 3:
        e = pose_error(cameras, truth)
        poses = [
            f"{e.rotation_deg_mean:.3f} / {e.rotation_deg_max:.3f}",
            f"{e.position_mean:.3%} / {e.position_max:.3%}",
        ]
    cells = [capture.name, program, str(threads), f"{len(cameras)} / {len(capture.views)}"]
    cells += [f"{points:,}", f"{error:.2f}", *poses, *(f"{s:.1f}" for s in seconds)]
    return "| " + " | ".join(cells) + " |"


def _children() -> float:
    """Return the processor seconds of processes that this one started and that ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
