"""Speed is measured where it says, and again when it is asked for, with the same splats."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.errors import StageError
from mattgs_ops.store import provenance
from tasks.measure import MACHINE, Speed, measure, with_speed
from tasks.row import Outcome
from tasks.stages.stage import Artifact, Cell, Place
from tasks.train import train

CELL = Cell("ball", "nobg-3dgs", 0)
Put = Callable[[Place], Artifact]


def sitting(place: Place, name: str | None) -> Place:
    return replace(place, run=place.run.model_copy(update={"sitting": name}))


def trained(place: Place, config: BenchmarkConfig, scene: Artifact) -> Outcome:
    splats = train(place, CELL, scene, config)
    return Outcome(CELL, {"sfm": scene, "train": splats})


def test_a_new_sitting_times_again_what_was_in_the_store(
    place: Place, config: BenchmarkConfig, put_scene: Put
) -> None:
    scene = put_scene(place)
    outcome = trained(place, config, scene)
    first = measure(place, "ball", [outcome], config)[CELL]
    here = provenance.describe(1)
    assert first.machine == {name: here[name] for name in MACHINE}
    assert first.laps == []
    assert measure(place, "ball", [outcome], config)[CELL] == first, "asked for again: known"

    just_now = measure(sitting(place, "a"), "ball", [outcome], config)[CELL]
    assert just_now.laps == [], "the training was done just now"
    assert just_now.metrics["fps"] != first.metrics["fps"]
    stored = trained(place, config, scene)
    assert stored.artifacts["train"].cached
    again = measure(sitting(place, "b"), "ball", [stored], config)[CELL]
    assert again.laps
    assert again.metrics["time"] > 0
    assert measure(sitting(place, "b"), "ball", [stored], config)[CELL] == again, "an interrupted"


def test_a_training_that_comes_to_other_splats_is_told(
    place: Place, config: BenchmarkConfig, put_scene: Put
) -> None:
    scene = put_scene(place)
    trained(place, config, scene)
    stored = trained(place, config, scene)
    path = place.folder(stored.artifacts["train"]) / "splats.ply"
    data = bytearray(path.read_bytes())
    data[-4] ^= 1  # one bit of one splat: as if this training had ended a little otherwise
    path.write_bytes(data)
    with pytest.raises(StageError, match="not deterministic here"):
        measure(sitting(place, "c"), "ball", [stored], config)


def test_a_row_says_where_its_speed_was_measured() -> None:
    row: dict[str, Any] = {"metrics": {"psnr": 20.0, "time": 3.0}}
    row["provenance"] = {"cpu": "A", "threads": 1}
    assert with_speed(row, None) == row
    found = with_speed(row, Speed({"fps": 50.0}, {"cpu": "B"}, []))
    assert found["metrics"] == {"psnr": 20.0, "time": 3.0, "fps": 50.0}
    assert found["provenance"] == row["provenance"] | {"measured": {"cpu": "B"}}
    laps = [{"value": 1.0, "calibration": 0.1}]
    again = with_speed(row, Speed({"fps": 50.0, "time": 1.0}, {"cpu": "B"}, laps))
    assert again["provenance"]["timed"] == {"cpu": "B"}
    assert again["repeats"] == {"time": laps}
