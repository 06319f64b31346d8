"""``mattgs init``: what it writes is valid, explains itself, and overwrites nothing.

That it runs is shown by ``tests/flows/test_whole_line.py``, which begins with it.
"""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

import mattgs_ops
from flows.cli.app import app
from flows.starter import write as starter
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError

BUNDLED = Path(mattgs_ops.__file__).parent / "bundled" / "lattepanda" / "images"
SIZE = (320, 240)


def photos_in(folder: Path, count: int = starter.FEWEST_PHOTOS) -> None:
    folder.mkdir(parents=True)
    for path in sorted(BUNDLED.glob("*.jpg"))[:count]:
        with Image.open(path) as photo:
            photo.resize(SIZE).save(folder / path.name, quality=95)


def init(folder: Path, monkeypatch: pytest.MonkeyPatch, *options: str | Path) -> str:
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(app, ["init", *map(str, options)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def captures_of(folder: Path) -> dict[str, Path | None]:
    return {one.name: one.path for one in load_toml(folder / "benchmark.toml").captures}


def test_photos_of_the_folder_become_its_capture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "my gripper"
    photos_in(folder / "photos")
    told = init(folder, monkeypatch)
    assert captures_of(folder) == {"my-gripper": (folder / "photos").resolve()}
    assert load_toml(folder / "benchmark.toml").name == "my-gripper"
    assert "Written: benchmark.toml" in told
    assert "Next: mattgs run --config benchmark.toml" in told


def test_a_folder_for_each_object_becomes_a_capture_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("cup", "shoe"):
        photos_in(tmp_path / "elsewhere" / name)
    (tmp_path / "elsewhere" / "empty").mkdir()
    work = tmp_path / "work"
    work.mkdir()
    init(work, monkeypatch, "--photos", tmp_path / "elsewhere", "--name", "things")
    assert captures_of(work) == {n: tmp_path / "elsewhere" / n for n in ("cup", "shoe")}


def test_folders_of_any_names_become_captures_of_different_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("объект", "предмет", "a b", "a-b", "🚗 car"):
        photos_in(tmp_path / "photos" / name)
    init(tmp_path, monkeypatch)
    found = captures_of(tmp_path)
    assert len(found) == 5
    assert {"a-b", "a-b-2", "car"} <= found.keys()
    assert {path.name for path in found.values() if path} == {
        path.name for path in (tmp_path / "photos").iterdir()
    }


def test_poses_and_masks_beside_photos_stay_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("images", "images_2", "masks", "sparse/0", ".thumbnails"):
        photos_in(tmp_path / name)
    init(tmp_path, monkeypatch)
    assert list(captures_of(tmp_path).values()) == [tmp_path]
    posed, work = tmp_path / "posed", tmp_path / "work"
    photos_in(posed / "images")
    (posed / "transforms.json").write_text("{}")
    work.mkdir()
    init(work, monkeypatch, "--photos", posed)
    assert captures_of(work) == {"posed": posed}


def test_without_photos_a_bundled_capture_stands_in_and_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "No photos were found in photos or images" in init(tmp_path, monkeypatch)
    assert captures_of(tmp_path) == {"rover": None}
    with pytest.raises(InputError, match="expected at least 3 photos, or folders of them"):
        starter.write(tmp_path / "other", tmp_path)


def test_nothing_is_overwritten_and_nothing_half_written(tmp_path: Path) -> None:
    (tmp_path / "prefect.yaml").write_text("mine")
    with pytest.raises(InputError, match=r"found prefect\.yaml; move them away"):
        starter.write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["prefect.yaml"]
    assert (tmp_path / "prefect.yaml").read_text() == "mine"


def test_the_workflow_has_what_github_asks_for_and_known_options(tmp_path: Path) -> None:
    starter.write(tmp_path, name="mine")
    text = (tmp_path / starter.WORKFLOW).read_text(encoding="utf-8")
    document: dict[Any, Any] = yaml.safe_load(text)
    assert set(document[True]) == {"pull_request", "workflow_dispatch"}  # YAML 1.1 reads `on` so
    steps = document["jobs"]["gate"]["steps"]
    assert all(len({"uses", "run"} & step.keys()) == 1 for step in steps)
    assert text.count("${{") == text.count("}}")
    assert "@" not in text.replace("@v", "").replace(json.dumps(starter.source()), "")
    for command in ("gate", "run", "baseline"):
        known = CliRunner().invoke(app, [command, "--help"], terminal_width=200).output
        (line,) = [one.split() for one in text.splitlines() if f" mattgs {command} " in one]
        assert all(f"{word} " in known for word in line if word.startswith("--"))


def test_the_schedule_names_a_flow_and_parameters_that_it_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from prefect.flows import load_flow_from_entrypoint

    starter.write(tmp_path, name="mine")
    monkeypatch.chdir(tmp_path)
    (entry,) = yaml.safe_load((tmp_path / starter.SCHEDULE).read_text())["deployments"]
    flow: Any = load_flow_from_entrypoint(entry["entrypoint"])
    found = flow.validate_parameters(entry["parameters"])["settings"]
    assert (found.name, found.config) == ("mine", Path("benchmark.toml"))
    assert found.gate.baseline == "baseline.json"
