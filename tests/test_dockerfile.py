"""The image's recipe: linted, and made of what the project says. It is not built here."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import yaml
from prefect import Flow
from prefect.flows import load_flow_from_entrypoint

from flows.scheduled import DEPLOYMENTS, IMAGE_FOLDER, prefect_file

ROOT = Path(__file__).resolve().parents[1]
RECIPE = ROOT / "Dockerfile"
LINTER = Path(sys.executable).with_name("hadolint")  # of the extra `dev`


def lint(recipe: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([LINTER, recipe], capture_output=True, text=True, check=False, timeout=60)


def test_the_linter_finds_nothing() -> None:
    done = lint(RECIPE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_linter_would_find_something(tmp_path: Path) -> None:
    harmed = tmp_path / "Dockerfile"
    harmed.write_text(re.sub(r"FROM python:\S+", "FROM python", RECIPE.read_text("utf-8")))
    assert "DL3006" in lint(harmed).stdout, "an image without a version"


def test_it_installs_the_versions_that_the_project_says() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    text = RECIPE.read_text("utf-8")
    (torch,) = (d for d in project["dependencies"] if d.startswith("torch=="))
    assert f"{torch} " in text
    assert f"mattgs-bench:{project['version']} " in text
    assert set(re.findall(r"^FROM python:(\d+\.\d+)", text, re.MULTILINE)) == {"3.11"}
    assert f"WORKDIR {IMAGE_FOLDER}\n" in text


def test_an_images_deployments_are_the_same_ones_and_load_without_a_file(
    tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    content = yaml.safe_load(prefect_file("registry.lab/mattgs-bench:0.1.0"))
    assert content["pull"][0].popitem()[1] == {"directory": IMAGE_FOLDER}
    assert len(content["deployments"]) == len(DEPLOYMENTS)
    for entry, one in zip(content["deployments"], DEPLOYMENTS, strict=True):
        image = entry["work_pool"]["job_variables"]["image"]
        assert image == "registry.lab/mattgs-bench:0.1.0"
        loaded: Flow[..., Any] = load_flow_from_entrypoint(entry["entrypoint"])
        assert isinstance(loaded, Flow)
        assert f"{loaded.name}/{entry['name']}" == str(one)
        loaded.validate_parameters(entry["parameters"])
