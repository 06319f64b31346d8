"""What identifies an experiment: what was asked for, not what the code happens to default to."""

import json
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.config import NO_RESULT, BenchmarkConfig
from mattgs_ops.method import METHODS, MethodConfig
from mattgs_ops.store.keys import stage_key
from mattgs_ops.store.store import Store
from tasks.row import _trained_on, _warnings, config_digest, settings
from tasks.stages.stage import Artifact, Cell, Place

CELL = Cell("rover", "nobg-ours", 0)


def digest(**values: Any) -> str:
    return config_digest(BenchmarkConfig.model_validate(values), CELL)


def test_saying_a_default_changes_nothing() -> None:
    default = BenchmarkConfig()
    said = default.model_dump(mode="json")
    assert digest(**said) == digest()
    assert digest(run={"workers": 7, "threads": 3}) == digest()


@pytest.mark.parametrize("name", NO_RESULT)
def test_what_changes_no_result_is_no_other_configuration(name: str) -> None:
    assert digest(train={name: 50}) == digest()
    assert digest(train={name: 50, "lr_opacity": 0.05}) == digest(train={"lr_opacity": 0.05})


@pytest.mark.parametrize(
    "change",
    [
        {"iterations": 77},
        {"resolution": 64},
        {"test_every": 4},
        {"train": {"lr_opacity": 0.05}},
        {"sfm": {"max_features": 100}},
        {"segment": {"source": "given"}},
        {"methods": {"ours": {"weighting": "residual"}}},
    ],
)
def test_whatever_is_asked_otherwise_changes_it(change: dict[str, Any]) -> None:
    assert digest(**change) != digest()


def test_a_model_counts_by_its_content(tmp_path: Path) -> None:
    for name, content in (("a.onnx", b"one"), ("b.onnx", b"one"), ("c.onnx", b"two")):
        (tmp_path / name).write_bytes(content)
    digests = [digest(segment={"model": str(tmp_path / f"{name}.onnx")}) for name in "abc"]
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]
    assert digest() not in digests


def test_another_default_of_a_method_is_code_not_configuration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = digest()
    monkeypatch.setitem(METHODS, "ours", MethodConfig(weighting="residual"))
    assert digest() == before
    recorded = settings(BenchmarkConfig(), CELL)["method_settings"]
    assert recorded["weighting"] == "residual", "the registry still shows what was done"


def put(place: Place, stage: str, files: dict[str, Any]) -> Artifact:
    key = stage_key(stage, "test", {}, {})
    with Store(place.store).stage(key) as slot:
        for name, content in files.items():
            (slot.work / name).write_text(json.dumps(content))
        done = slot.finish({"seconds": 1.0})
    return Artifact(stage, done.key, done.digest, 1.0, cached=False)


@pytest.mark.parametrize("doubtful", [True, False])
def test_lost_views_and_unlike_exposures_travel_with_the_row(place: Place, doubtful: bool) -> None:
    masks: dict[str, Any] = {
        "source": "u2net",
        "refine": "none",
        "model": None,
        "views": [],
        "mean_iou": None,
    }
    extra = {"warnings": ["only 9 of 14 views have a camera"], "poses_in_doubt": doubtful}
    artifacts = {
        "segment": put(place, "segment", {"masks.json": masks}),
        "sfm": put(place, "sfm", {"scene.json": {"extra": extra, "views": []}}),
        "train": put(place, "train", {"exposures.json": {"spread": 2.0, "photos": {}}}),
    }
    poses, exposure = _warnings(place, artifacts)
    assert (poses["about"], poses["serious"]) == ("poses", doubtful)
    assert poses["text"] == "only 9 of 14 views have a camera"
    assert (exposure["about"], exposure["serious"]) == ("exposure", False)


def test_a_budget_is_part_of_what_was_asked_for() -> None:
    config = BenchmarkConfig(budgets=(5000, 9000))
    cells = [Cell("rover", "nobg-ours", 0, budget) for budget in (5000, 9000)]
    assert [str(cell) for cell in cells] == [
        "rover nobg-ours 5000 splats seed 0",
        "rover nobg-ours 9000 splats seed 0",
    ]
    assert len({config_digest(config, cell) for cell in (*cells, CELL)}) == 3
    asked = settings(config, cells[0])
    assert (asked["budget"], asked["train"]["max_splats"]) == (5000, 5000)
    assert Cell.of({"capture": "rover", "condition": "nobg-ours", "seed": 0}) == CELL


def test_where_a_trainer_lies_is_no_part_of_what_was_asked_for(tmp_path: Path) -> None:
    def found(**settings: Any) -> str:
        table = {"command": ["{here}/train"], **settings}
        config = BenchmarkConfig.model_validate(
            {"trainers": {"peer": table}, "conditions": ["nobg-peer"]}
        )
        return config_digest(config, Cell("rover", "nobg-peer", 0))

    assert found() == found(folder=tmp_path, timeout=5)
    assert found() != found(command=["{here}/train", "--more"])


def test_a_row_names_all_photos_that_were_trained_on(tmp_path: Path) -> None:
    """Whatever the trainer said; else the scene's training views with a camera."""
    views = [
        {"name": "b.jpg", "split": "train", "camera": {"intrinsics": {}}},
        {"name": "a.jpg", "split": "train", "camera": {"intrinsics": {}}},
        {"name": "c.jpg", "split": "train", "camera": None},
        {"name": "d.jpg", "split": "test", "camera": {"intrinsics": {}}},
    ]
    (tmp_path / "scene.json").write_text(json.dumps({"views": views}))
    assert _trained_on({"trained_on": ["d.jpg", "a.jpg"]}, tmp_path) == ["a.jpg", "d.jpg"]
    assert _trained_on({}, tmp_path) == ["a.jpg", "b.jpg"]
