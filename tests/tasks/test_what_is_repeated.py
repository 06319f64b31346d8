"""A change repeats exactly what depends on it: the keys of a whole grid before and after.

Nothing is computed: each stage's result is taken to be new when its key is.
"""

import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from flows.grid import cells
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.store import provenance
from mattgs_ops.store.keys import stage_key
from tasks import agree, evaluate, measure, prepare, segment, sfm, train
from tasks.row import Outcome
from tasks.stages.stage import Artifact, Place, Stage, code_versions

MODULES = (prepare, segment, sfm, agree, train, evaluate, measure)
Keys = Mapping[str, str]  # title of a stage → its key
Asked = Callable[..., Keys]


@pytest.fixture
def settings(tmp_path: Path) -> dict[str, Any]:
    """Two captures, two conditions, two seeds; masks are voted on."""
    for name in ("cup", "bolt"):
        (tmp_path / name).mkdir()
        for index in range(3):
            (tmp_path / name / f"{index}.jpg").write_text(f"photo {index} of {name}")
    return {
        "captures": [{"name": name, "path": tmp_path / name} for name in ("cup", "bolt")],
        "conditions": ["nobg-3dgs", "nobg-ours"],
        "seeds": [0, 1],
    }


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Asked:
    """Return a function that asks for every stage of a grid, as the flow does."""

    def keys(settings: dict[str, Any], versions: Mapping[str, str] | None = None) -> Keys:
        found: dict[str, str] = {}
        known = code_versions() | dict(versions or {})

        def perform(place: Place, stage: Stage) -> Artifact:
            key = stage_key(stage.name, known[stage.name], stage.parameters, stage.inputs)
            found[stage.title] = str(key)
            made = Artifact(
                stage.name, str(key), sha256(str(key).encode()).hexdigest(), 1.0, cached=False
            )
            if stage.name == "measure":
                nothing: dict[str, Any] = {"metrics": {}, "machine": {}, "laps": []}
                speeds = {job["label"]: nothing for job in stage.arguments["jobs"]}
                place.folder(made).mkdir(parents=True, exist_ok=True)
                (place.folder(made) / measure.SPEED_FILE).write_text(json.dumps(speeds))
            return made

        for module in MODULES:
            monkeypatch.setattr(module, "perform", perform)
        config = BenchmarkConfig.model_validate(settings)
        _ask(Place(tmp_path / "out", config.name, config.run), config)
        return found

    return keys


def _ask(place: Place, config: BenchmarkConfig) -> None:
    for capture in config.captures:
        name = capture.name
        prepared = prepare.prepare(place, capture, config)
        masks = segment.segment(place, name, prepared, config.segment)
        solved = sfm.sfm(place, name, prepared, masks, config.sfm)
        scene = agree.agree(place, name, prepared, solved)
        outcomes = []
        for cell in cells(config, name):
            splats = train.train(place, cell, scene, config)
            evaluate.evaluate(place, cell, scene, splats, config)
            outcomes.append(Outcome(cell, {"sfm": solved, "agree": scene, "train": splats}))
        measure.measure(place, name, outcomes, config)


def repeated(before: Keys, after: Keys) -> set[str]:
    """Return the titles of the stages whose key is another one."""
    assert before.keys() == after.keys()
    return {title for title in before if before[title] != after[title]}


def of(keys: Keys, *kinds: str, where: str = "") -> set[str]:
    """Return the titles of stages of some kinds, all of them without; those that hold ``where``."""
    return {t for t in keys if (not kinds or t.split()[0] in kinds) and where in t}


def test_a_changed_photo_repeats_its_own_capture_and_no_other(
    settings: dict[str, Any], asked: Asked, tmp_path: Path
) -> None:
    before = asked(settings)
    (tmp_path / "cup" / "1.jpg").write_text("another photo")
    assert repeated(before, asked(settings)) == of(before, where="cup")


def test_a_photo_that_was_only_touched_or_moved_repeats_nothing(
    settings: dict[str, Any], asked: Asked, tmp_path: Path
) -> None:
    before = asked(settings)
    (tmp_path / "cup" / "1.jpg").touch()
    (tmp_path / "bolt").rename(tmp_path / "elsewhere")
    settings["captures"][1]["path"] = tmp_path / "elsewhere"
    assert repeated(before, asked(settings)) == set()


def test_a_capture_under_another_name_repeats_nothing(
    settings: dict[str, Any], asked: Asked
) -> None:
    before = asked(settings)
    settings["captures"][0]["name"] = "mug"
    assert set(asked(settings).values()) == set(before.values())


TRAINED = ("train", "evaluate", "measure")
SOLVED = ("sfm", "agree", "truth", *TRAINED)


@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        ({"test_every": 4}, ()),
        ({"segment": {"threshold": 0.6}}, ("segment", *SOLVED)),
        ({"sfm": {"max_features": 999}}, SOLVED),
        ({"iterations": 77}, TRAINED),
        ({"resolution": 99}, ("truth", *TRAINED)),
        ({"train": {"lr_opacity": 0.5}}, TRAINED),
        ({"train_views": 3}, ("truth", "evaluate")),
        ({"train": {"checkpoint_every": 3}}, ("none",)),
        ({"name": "other"}, ("none",)),
        ({"run": {"workers": 7, "threads": 2, "retries": 0}}, ("measure",)),
        ({"run": {"workers": 7, "retries": 0}}, ("none",)),
    ],
    ids=str,
)
def test_a_changed_setting_repeats_what_depends_on_it(
    settings: dict[str, Any],
    asked: Asked,
    change: dict[str, Any],
    kinds: tuple[str, ...],
) -> None:
    before = asked(settings)
    assert repeated(before, asked(settings | change)) == of(before, *kinds)


def test_a_changed_method_repeats_its_own_experiments(
    settings: dict[str, Any], asked: Asked
) -> None:
    before = asked(settings)
    after = asked(settings | {"methods": {"ours": {"weighting": "residual", "weight": 2.0}}})
    ours = of(before, where="nobg-ours")
    assert repeated(before, after) == ours | of(before, "measure")


def test_another_seed_adds_its_experiments_and_repeats_the_measuring_alone(
    settings: dict[str, Any], asked: Asked
) -> None:
    before = asked(settings)
    after = asked(settings | {"seeds": [0, 1, 2]})
    assert after.keys() - before.keys() == of(after, where="seed 2")
    same = {title: after[title] for title in before}
    assert repeated(before, same) == of(before, "measure")


@pytest.mark.parametrize(
    ("stage", "kinds"),
    [
        ("segment", ("segment", *SOLVED)),
        ("sfm", SOLVED),
        ("agree", ("agree", "truth", *TRAINED)),
        ("train", TRAINED),
        ("truth", ("truth", "evaluate")),
        ("evaluate", ("evaluate",)),
        ("measure", ("measure",)),
    ],
)
def test_changed_code_repeats_its_stage_and_what_follows(
    settings: dict[str, Any], asked: Asked, stage: str, kinds: tuple[str, ...]
) -> None:
    before = asked(settings)
    assert repeated(before, asked(settings, {stage: "changed"})) == of(before, *kinds)


@pytest.mark.parametrize("run", [{"threads": 8}, {"sitting": "tonight"}])
def test_more_threads_or_a_new_sitting_measure_speed_anew_and_repeat_nothing_else(
    settings: dict[str, Any], asked: Asked, run: dict[str, Any]
) -> None:
    before = asked(settings)
    assert repeated(before, asked(settings | {"run": run})) == of(before, "measure")


@pytest.mark.parametrize("told", ["cpu_model", "cpu_kind"])
def test_speed_of_another_processor_is_another_speed(
    settings: dict[str, Any], asked: Asked, monkeypatch: pytest.MonkeyPatch, told: str
) -> None:
    before = asked(settings)
    monkeypatch.setattr(provenance, told, lambda: "another")
    assert repeated(before, asked(settings)) == of(before, "measure")
