"""Another program as a method: run in its own process, scored as any, refused by what it did."""

import json
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.errors import StageError
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.files.training_report import TrainingReport
from mattgs_ops.store.provenance import git_commit
from tasks.evaluate import evaluate
from tasks.row import Outcome, make_row
from tasks.stages.stage import Artifact, Cell, Place
from tasks.stages.status import read
from tasks.train import train

EXAMPLE = Path(__file__).parents[2] / "benchmarks" / "peers" / "torch_trainer.py"
PEER = Path(__file__).parents[1] / "mattgs_ops" / "trainers" / "peer.py"
LOAD_FILE = "load.csv"  # how busy the machine was, which every stage notes
CELL = Cell("ball", "nobg-peer", 0)
Put = Callable[[Place], Artifact]


def with_peer(config: BenchmarkConfig, way: str, **settings: Any) -> BenchmarkConfig:
    command = [sys.executable, "{here}/peer.py", way, "{data}", "{output}", "{iterations}"]
    table = {"command": command, "folder": PEER.parent} | settings
    changed = {"trainers": {"peer": table}, "conditions": ["nobg-peer", "original-peer"]}
    return BenchmarkConfig.model_validate(config.model_dump() | changed)


@pytest.fixture
def scene(place: Place, put_scene: Put) -> Artifact:
    return put_scene(place)


@pytest.mark.parametrize("layout", ["colmap", "nerfstudio", "nerf"])
def test_its_splats_are_scored_like_any_others(
    place: Place, config: BenchmarkConfig, scene: Artifact, layout: str
) -> None:
    version = [sys.executable, "{here}/peer.py", "--version"]
    config = with_peer(config, "works", layout=layout, version=version)
    splats = train(place, CELL, scene, config)
    folder = place.folder(splats)
    kept = {path.name for path in folder.iterdir()} - {LOAD_FILE}
    assert kept == {"splats.ply", "training.json", "trainer.json"}, "nothing else that it wrote"
    report = TrainingReport.load(folder)
    assert report.splats == len(read_ply(folder / "splats.ply")) == report.starting_splats
    assert report.wall_seconds > 0
    assert report.cpu_seconds > 0
    assert report.peak_memory_mib > 1
    said = json.loads((folder / "trainer.json").read_text())
    assert said["identity"]["version"] == "peer 1.2"
    assert PEER.name in said["identity"]["files"]
    scores = evaluate(place, CELL, scene, splats, config)
    row = make_row(place, config, Outcome(CELL, {"sfm": scene, "train": splats}, "not yet"))
    assert row["provenance"]["trainer"]["identity"]["version"] == "peer 1.2"
    metrics = json.loads((place.folder(scores) / "evaluation.json").read_text())["metrics"]
    assert metrics["psnr"] > 20
    assert metrics["size_mb"] == (folder / "splats.ply").stat().st_size / 1e6


def test_the_example_in_torch_learns(
    place: Place, config: BenchmarkConfig, scene: Artifact
) -> None:
    command = ["{python}", "{here}/torch_trainer.py", "{data}", "{output}/splats.ply"]
    command += ["{iterations}", "{seed}", "{threads}"]
    table = {"command": command, "folder": EXAMPLE.parent, "layout": "nerfstudio"}
    changed = {"trainers": {"torch": table}, "conditions": ["nobg-torch"], "iterations": 100}
    config = BenchmarkConfig.model_validate(config.model_dump() | changed)
    cell = Cell("ball", "nobg-torch", 0)
    splats = train(place, cell, scene, config)
    said = json.loads((place.folder(splats) / "trainer.json").read_text())
    assert EXAMPLE.name in said["identity"]["files"]
    evaluate(place, cell, scene, splats, config)  # which looks at the frame, too
    (log,) = place.logs.glob("train*.log")
    losses = [float(loss) for loss in re.findall(r"step \d+: ([\d.]+)", log.read_text())]
    assert len(losses) == 10
    assert sum(losses[-3:]) / 3 < 0.8 * losses[0]


def test_it_says_how_far_it_is_and_leaves_its_lines_in_the_log(
    place: Place, config: BenchmarkConfig, scene: Artifact
) -> None:
    train(place, CELL, scene, with_peer(config, "works"))
    (status,) = [read(path) for path in place.status.glob("train*.json")]
    assert status is not None
    assert (status.done, status.total) == (config.iterations, config.iterations)
    (log,) = place.logs.glob("train*.log")
    assert "Step 40: 0.1" in log.read_text()


def test_it_is_repeated_when_its_script_or_its_command_changes(
    place: Place, config: BenchmarkConfig, scene: Artifact, tmp_path: Path
) -> None:
    script = tmp_path / "peer.py"
    script.write_bytes(PEER.read_bytes())
    first = train(place, CELL, scene, with_peer(config, "works", folder=tmp_path))
    again = train(place, CELL, scene, with_peer(config, "works", folder=tmp_path, timeout=60))
    assert again.cached
    assert again.key == first.key
    with script.open("a") as file:
        file.write("# another version\n")
    other = train(place, CELL, scene, with_peer(config, "works", folder=tmp_path))
    assert other.key != first.key


@pytest.mark.parametrize(
    ("way", "what"),
    [
        ("fails", "trainer peer: its process ended with status 1: .*no CUDA here"),
        ("nothing", r"trainer peer: .*wrote no file that is a \.ply, \.splat or \.spz: nothing"),
        ("two", "it wrote 2 files that are .*last.ply.*name one in `result`"),
        (
            "nan",
            "cannot be read: .*point_cloud.ply: .*NaN or infinity in `means` of vertex 3",
        ),
        ("text", "cannot be read: splats.ply: expected a PLY file with splats"),
        ("empties", "holds no splat"),
    ],
)
def test_what_went_wrong_is_told(
    place: Place, config: BenchmarkConfig, scene: Artifact, way: str, what: str
) -> None:
    config = with_peer(config, way)
    with pytest.raises(StageError, match=what) as caught:
        train(place, CELL, scene, config)
    row = make_row(place, config, Outcome(CELL, {"sfm": scene}, str(caught.value)))
    assert row["status"] == "failed"
    assert "trainer peer" in row["reason"]
    assert row["provenance"]["git"] == git_commit(), "of the code that failed"


@pytest.mark.parametrize(
    ("way", "what"),
    [
        ("moves", "worse, .* dB, than one flat colour would.* frame .*spread 0.5 times"),
        ("turns", "[0-2] of 7 are liker to their own photo.* frame .*spread (1|0.9.) times"),
    ],
)
def test_another_coordinate_frame_is_told(
    place: Place, config: BenchmarkConfig, scene: Artifact, way: str, what: str
) -> None:
    config = with_peer(config, way)
    splats = train(place, CELL, scene, config)
    with pytest.raises(StageError, match=what):
        evaluate(place, CELL, scene, splats, config)


def test_one_of_several_files_can_be_named(
    place: Place, config: BenchmarkConfig, scene: Artifact
) -> None:
    result = "point_cloud/iteration_{iterations}/point_cloud.ply"
    splats = train(place, CELL, scene, with_peer(config, "two", result=result))
    assert len(read_ply(place.folder(splats) / "splats.ply")) > 0


def test_a_program_that_is_not_there_is_told(
    place: Place, config: BenchmarkConfig, scene: Artifact
) -> None:
    with pytest.raises(StageError, match="trainer peer: there is no program 'nowhere-to-be'"):
        train(place, CELL, scene, with_peer(config, "works", command=["nowhere-to-be", "{data}"]))


def test_a_version_that_is_not_told_is_an_error(
    place: Place, config: BenchmarkConfig, scene: Artifact
) -> None:
    version = [sys.executable, "-c", "raise SystemExit('too old')"]
    with pytest.raises(StageError, match="version command ended with status 1 and said: too old"):
        train(place, CELL, scene, with_peer(config, "works", version=version))


def test_one_that_takes_too_long_is_ended_with_its_process(
    place: Place, config: BenchmarkConfig, scene: Artifact
) -> None:
    for limit in (3, 10, 40):  # more where it did not come so far as to sleep
        with pytest.raises(StageError, match=f"took longer than {limit} s and was ended"):
            train(place, CELL, scene, with_peer(config, "sleeps", timeout=limit))
        (log,) = place.logs.glob("train*.log")
        if "photos, one by one" in log.read_text():
            break
    else:
        pytest.fail("it never slept")
    deadline = time.monotonic() + 10
    while _running() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _running()


def _running() -> list[int]:
    """Return the sleeping peers of this test."""
    found = []
    for process in psutil.process_iter(["cmdline", "status"]):
        line = process.info["cmdline"] or []
        if "sleeps" in line and str(PEER) in line and process.info["status"] != "zombie":
            found.append(process.pid)
    return found
