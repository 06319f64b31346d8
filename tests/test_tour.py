"""The tour's page: five ways, commands with options that exist, pictures that are there.

``python benchmarks/tour/run.py`` runs them; that takes minutes.
"""

import importlib.util
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image
from typer.testing import CliRunner

from flows.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "tour.md"
MOST_BYTES = 200_000  # of one picture


@pytest.fixture
def tour(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    folder = ROOT / "benchmarks" / "tour"
    monkeypatch.syspath_prepend(str(folder))
    spec = importlib.util.spec_from_file_location("tour_run", folder / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "tour_run", module)
    spec.loader.exec_module(module)
    return module


def test_there_are_five_ways_and_each_has_commands(tour: ModuleType) -> None:
    ways = tour.ways(PAGE.read_text(encoding="utf-8"))
    assert [title[:2] for title in ways] == ["1.", "2.", "3.", "4.", "5."]
    for blocks in ways.values():
        assert blocks
        assert {block.kind for block in blocks} <= {"", "server", "workflow"}
    kinds = [block.kind for blocks in ways.values() for block in blocks]
    assert kinds.count("server") == 4
    assert kinds.count("workflow") == 1


def test_the_commands_have_the_options_that_they_are_given(tour: ModuleType) -> None:
    ways = tour.ways(PAGE.read_text(encoding="utf-8"))
    texts = [block.text for blocks in ways.values() for block in blocks]
    lines = [line for text in texts for line in text.splitlines()]
    calls = [shlex.split(line) for line in lines if line.startswith("mattgs ")]
    assert len(calls) > 8
    for _, command, *words in calls:
        known = CliRunner().invoke(app, [command, "--help"], terminal_width=200).output
        for word in words:
            if word.startswith("--"):
                assert word in known, (command, word)


def test_the_pages_pictures_are_there_and_small() -> None:
    names = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", PAGE.read_text(encoding="utf-8"))
    assert len(names) >= 4, "MLflow's list, run and system metrics, Prefect's next runs"
    for name in names:
        file = PAGE.parent / name
        assert file.stat().st_size < MOST_BYTES, name
        with Image.open(file) as picture:
            assert picture.width >= 1000
