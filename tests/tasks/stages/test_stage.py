"""Stages and the store: done once, done whole, and gone on with after a kill."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from mattgs_ops.config import BenchmarkConfig, RunConfig
from mattgs_ops.errors import StageError
from mattgs_ops.method import MethodConfig
from mattgs_ops.store.store import Store
from tasks.evaluate import evaluate
from tasks.measure import measure
from tasks.registry.live_curves import read_points
from tasks.row import Outcome
from tasks.stages import cores, quiet
from tasks.stages.stage import Artifact, Cell, Place, Stage, _turn, perform
from tasks.stages.status import StatusFile, read, read_all
from tasks.train import train
from tests.tasks.waiting import wait_for

CELL = Cell("ball", "nobg-ours", 0)
PutScene = Callable[[Place], Artifact]

TRAIN = """
import sys
from pathlib import Path
from mattgs_ops.config import BenchmarkConfig, RunConfig
from tasks.stages.stage import Artifact, Cell, Place
from tasks.train import train
out, key, digest, config, run = sys.argv[1:]
scene = Artifact("sfm", key, digest, 1.0, True)
made = train(
    Place(Path(out), "small", RunConfig.model_validate_json(run)),
    Cell("ball", "nobg-ours", 0),
    scene,
    BenchmarkConfig.model_validate_json(config),
)
print(made.cached)
"""


def start_training(place: Place, scene: Artifact, config: BenchmarkConfig) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    arguments = [str(place.out), scene.key, scene.digest, config.model_dump_json()]
    arguments.append(place.run.model_dump_json())
    command = [sys.executable, "-c", TRAIN, *arguments]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def states(place: Place) -> dict[str, str]:
    return {status.title: status.state for status in read_all(place.status)}


def test_an_experiment_is_trained_scored_measured_and_never_again(
    place: Place, config: BenchmarkConfig, put_scene: PutScene
) -> None:
    scene = put_scene(place)
    for again in (False, True):
        splats = train(place, CELL, scene, config)
        scores = evaluate(place, CELL, scene, splats, config)
        outcome = Outcome(CELL, {"sfm": scene, "train": splats, "evaluate": scores})
        speeds = measure(place, "ball", [outcome], config)
        assert (splats.cached, scores.cached) == (again, again)
    assert set(states(place).values()) <= {"done", "cached"}
    assert speeds[CELL].metrics["fps"] > 0
    evaluation = json.loads((place.folder(scores) / "evaluation.json").read_text())
    assert evaluation["metrics"].keys() >= {"psnr", "ssim", "l1", "loss", "size_mb", "mask_psnr"}
    machine = place.extra(splats)["machine"]
    assert machine["threads"] == 1
    assert machine["versions"]["torch"].startswith("2.13")


WAITING = """
import time

def until_told(arguments, out, threads, progress):
    while not (out.parents[3] / "go").exists():
        time.sleep(0.01)
    (out / "made").touch()
"""


def test_the_attempts_before_an_interruption_count_as_well(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    operation = """
def last_part(arguments, out, threads, progress):
    (out / "report.json").write_text('{"wall_seconds": 5000.0}')
"""
    (tmp_path / "operations_resumed.py").write_text(operation)
    monkeypatch.syspath_prepend(tmp_path)
    operation = "operations_resumed:last_part"
    stage = Stage("prepare", "prepare ball", operation, {}, {}, {}, counts="report.json")
    made = perform(place, stage)
    assert made.seconds == 5000
    assert place.extra(made)["began"] + 5000 == pytest.approx(time.time(), abs=100)


def test_what_two_experiments_ask_for_at_once_was_made_now_not_before(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "operations_waiting.py").write_text(WAITING)
    monkeypatch.syspath_prepend(tmp_path)
    stage = Stage("prepare", "truth ball nobg", "operations_waiting:until_told", {}, {}, {})
    asked: list[Place] = []
    real = Place.open_store

    def open_store(self: Place) -> Store:
        asked.append(self)
        return real(self)

    monkeypatch.setattr(Place, "open_store", open_store)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(perform, place, stage)
        wait_for(lambda: states(place) == {stage.title: "running"} and len(asked) == 1)
        second = pool.submit(perform, place, stage)
        wait_for(lambda: len(asked) == 2)
        (place.out / "go").touch()
        assert (first.result().cached, second.result().cached) == (False, True)
    (status,) = read_all(place.status)
    assert (status.state, status.key) == ("done", first.result().key)


def test_parameters_and_inputs_make_another_result_but_the_place_of_work_does_not(
    place: Place, config: BenchmarkConfig, put_scene: PutScene, tmp_path: Path
) -> None:
    scene = put_scene(place)
    short = config.model_copy(update={"iterations": 2})
    first = train(place, CELL, scene, short)
    moved = Place(tmp_path / "out", "other name", RunConfig(threads=2))
    assert train(moved, CELL, scene, short).cached
    others = [
        train(place, replace(CELL, seed=1), scene, short),
        train(place, replace(CELL, condition="nobg-3dgs"), scene, short),
        train(place, CELL, replace(scene, digest="0" * 64), short),
        train(place, CELL, scene, config.model_copy(update={"iterations": 3})),
    ]
    assert not any(other.cached for other in others)
    assert len({a.key for a in [first, *others]}) == 5


def test_a_failed_stage_says_why_and_leaves_nothing_in_the_store(
    place: Place, config: BenchmarkConfig, put_scene: PutScene
) -> None:
    scene = put_scene(place)
    (place.folder(scene) / "points.npz").unlink()
    with pytest.raises(StageError, match=r"points\.npz"):
        train(place, CELL, scene, config)
    assert states(place) == {"train ball nobg-ours seed 0": "failed"}
    assert not list(place.store.glob("train/*"))


def test_a_training_that_diverges_says_at_which_step(
    place: Place, config: BenchmarkConfig, put_scene: PutScene
) -> None:
    wild = MethodConfig(weighting="residual", weight=1e39)  # infinite as a 32-bit number
    diverging = config.model_copy(update={"methods": {"wild": wild}})
    with pytest.raises(StageError, match=r"step 1, view .*: the loss is nan"):
        train(place, Cell("ball", "nobg-wild", 0), put_scene(place), diverging)
    assert not list(place.store.glob("train/*"))


@pytest.mark.slow
def test_a_killed_training_goes_on_here_or_elsewhere_and_ends_in_the_same_bits(
    config: BenchmarkConfig, put_scene: PutScene, tmp_path: Path
) -> None:
    settings = config.train.model_copy(update={"checkpoint_every": 50})
    long = config.model_copy(update={"iterations": 600, "train": settings})
    shared = RunConfig(store=f"file://{tmp_path}/shared", checkpoint_copy_every=0.05)
    here, elsewhere = (Place(tmp_path / name, "small", shared) for name in ("here", "elsewhere"))
    scene = put_scene(here)
    flow = start_training(here, scene, long)
    wait_for(lambda: bool(list((tmp_path / "shared").glob("drafts/train/*/manifest.json"))))
    flow.send_signal(signal.SIGKILL)
    flow.communicate()
    assert states(here) == {"train ball nobg-ours seed 0": "interrupted"}

    alone = RunConfig()  # nothing shared: what lies in the folders is all there is
    straight = Place(tmp_path / "straight", "small", alone)
    put_scene(elsewhere), put_scene(straight)
    copied = elsewhere.folder(train(elsewhere, CELL, scene, long))
    resumed = here.folder(train(replace(here, run=alone), CELL, scene, long))
    whole = straight.folder(train(straight, CELL, scene, long))
    assert [resumed_from(folder) >= 50 for folder in (copied, resumed, whole)] == [1, 1, 0]
    for name in ("splats.ply", "start.npz"):
        kept = (whole / name).read_bytes()
        assert (copied / name).read_bytes() == (resumed / name).read_bytes() == kept
    steps = [[p["step"] for p in read_points(f / "curve.csv")] for f in (copied, resumed, whole)]
    assert steps[0] == steps[1] == steps[2]
    assert not list((tmp_path / "shared").glob("drafts/train/*")), "drafts go when all is done"


def resumed_from(folder: Path) -> int:
    return int(json.loads((folder / "training.json").read_text())["resumed_from"])


@pytest.mark.slow
def test_two_flows_never_do_the_same_stage_at_once(
    place: Place, config: BenchmarkConfig, put_scene: PutScene
) -> None:
    scene = put_scene(place)
    flows = [start_training(place, scene, config) for _ in range(2)]
    told = sorted(flow.communicate()[0].strip() for flow in flows)
    assert told == ["False", "True"]


def test_a_stage_says_which_run_holds_the_cores_that_it_waits_for(place: Place) -> None:
    status = StatusFile(place.status / "prepare.json")
    stage = Stage("prepare", "prepare ball", "m:f", {}, {}, {})

    def note() -> str:
        found = read(status.path)
        return "" if found is None else found.note

    def wait_and_go() -> None:
        with _turn(place, stage, status):
            pass

    status.begin(stage.title, stage.name)
    most = cores.own_cores()
    with ThreadPoolExecutor() as pool:
        with cores.taken(most, most, "other in /a/folder"):
            waits = pool.submit(wait_and_go)
            wait_for(lambda: note() == "waiting for a core, held by other in /a/folder")
        waits.result(60)
        with cores.taken(most, most, f"{place.benchmark} in {place.here}"):
            waits = pool.submit(wait_and_go)
            wait_for(lambda: note() == "waiting for a core")
        waits.result(60)
        with quiet.alone():
            waits = pool.submit(wait_and_go)
            wait_for(lambda: note() == "waiting until speed is measured")
        waits.result(60)
        stage = replace(stage, alone=True)
        with quiet.busy(), cores.taken(1, 1, "other in /a/folder"):
            waits = pool.submit(wait_and_go)
            wait_for(lambda: note() == "waiting for a quiet machine, held by other in /a/folder")
        waits.result(60)
    assert note() == ""


def test_a_worker_of_another_version_does_nothing_and_names_both(
    place: Place, config: BenchmarkConfig, put_scene: PutScene
) -> None:
    scene = put_scene(place)
    with pytest.raises(StageError, match=r"has mattgs-bench \d.*, the flow 9\.8\.7; install"):
        train(replace(place, version="9.8.7"), CELL, scene, config)
    assert states(place) == {}
