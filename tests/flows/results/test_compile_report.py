"""``mattgs report`` from files of rows: parts of one benchmark, without a registry."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flows.cli.app import app
from flows.results.compile_report import compile_report
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError
from tasks.row import config_digest
from tasks.stages.stage import Cell

Row = dict[str, Any]
GRID = """
name = "long"
captures = [{ name = "rover" }, { name = "hexapod" }]
conditions = ["nobg-3dgs", "nobg-ours"]
seeds = [0, 1]
iterations = 50
resolution = 64
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "long.toml"
    path.write_text(GRID)
    return path


def make_row(config: Path, capture: str, method: str, seed: int, **more: Any) -> Row:
    cell = Cell(capture, f"nobg-{method}", seed)
    views = [
        {"view": f"{i}.jpg", "split": "test", "psnr": 20.0 + i, "mask_psnr": 18.0 + i + seed}
        for i in range(3)
    ]
    means = {"ssim": 0.9, "psnr": 21.0, "mask_psnr": 19.0, "l1": 0.1, "loss": 0.1}
    return {
        "schema": 1, "protocol": 1, "benchmark": "long", "capture": capture,
        "condition": cell.condition, "background": "nobg", "method": method, "seed": seed,
        "iterations": 50, "resolution": 64, "status": "finished", "reason": None,
        "metrics": {**means, "fps": 9.0, "time": 60.0, "size_mb": 2.0}, "per_view": views,
        "provenance": {
            "config_digest": config_digest(load_toml(config), cell),
            "code_version": f"v{seed}", "cpu": f"CPU {seed}", "inputs": {"capture": capture},
        },
        "artifacts": {},
    } | more  # fmt: skip


def write(path: Path, rows: Sequence[Row]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(rows))
    return path


def test_two_sittings_become_one_report_that_says_what_is_missing(
    tmp_path: Path, config: Path
) -> None:
    first = write(tmp_path / "a.json", [make_row(config, "rover", m, 0) for m in ("3dgs", "ours")])
    second = write(tmp_path / "b.json", [make_row(config, "rover", "3dgs", 1)])
    out = tmp_path / "out"
    command = ["report", str(first), str(second), "--config", str(config), "--out", str(out)]
    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    folder = out / "benchmarks" / "long"
    assert done.output == f"Report: {folder / 'report.html'}\n"
    assert len(json.loads((folder / "rows.json").read_text())) == 3
    for text in (
        "3 of 8 experiments finished",
        f"Put together from 2 files of rows: {first} (2), {second} (1).",
        "5 of the grid&#39;s 8 experiments are missing.",
        "Not run yet, Rover: No BG · Ours (seed 1).",
        "Not run yet, Hexapod: No BG · 3DGS, No BG · Ours (seeds 0, 1).",
        "2 states of the code and 2 kinds of machine",
        "No BG · Ours: seed 0 only.",
        "Rover: no stored renders",
        "CPU 0",
        "CPU 1",
    ):
        assert text in (folder / "report.html").read_text("utf-8"), text
        plain = text.replace("&#39;", "'")
        if not plain.startswith("No BG"):
            assert plain in (folder / "report.md").read_text("utf-8"), plain


def test_a_complete_grid_has_nothing_missing(tmp_path: Path, config: Path) -> None:
    rows = [
        make_row(config, capture, method, seed)
        for capture in ("rover", "hexapod")
        for method in ("3dgs", "ours")
        for seed in (0, 1)
    ]
    file = write(tmp_path / "all.json", rows)
    text = compile_report([file], tmp_path / "out", config).read_text("utf-8")
    assert "8 of 8 experiments finished" in text
    assert "missing." not in text
    assert "Put together" not in text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"iterations": 60}, "has no rover nobg-ours seed 0 at 60x64"),
        ({"capture": "boat"}, "has no boat nobg-ours seed 0"),
        ({"provenance": {"config_digest": "f" * 64}}, "seed 0 was run with another configuration"),
        ({"benchmark": "short"}, "expected benchmark 'short', found 'long'"),
    ],
)
def test_rows_that_are_not_of_the_grid_are_refused(
    tmp_path: Path, config: Path, change: Row, words: str
) -> None:
    file = write(tmp_path / "a.json", [make_row(config, "rover", "ours", 0) | change])
    with pytest.raises(InputError) as caught:
        compile_report([file], tmp_path / "out", config)
    assert words in str(caught.value)
    assert str(config) in str(caught.value)


def test_a_files_own_output_folder_gives_the_pictures_that_are_still_there(
    pictured: tuple[list[Row], Path], tmp_path: Path
) -> None:
    rows, root = pictured
    here = tmp_path / "sitting-2"
    shutil.copytree(root, here / "store")
    kept = write(here / "benchmarks" / "toy" / "rows.json", rows[2:])
    gone = write(tmp_path / "sitting-1.json", rows[:2])
    text = compile_report([gone, kept], tmp_path / "out").read_text("utf-8")
    assert "Rover, Original · 3DGS, Original · Ours: no stored renders" in text
    assert 'id="figure-comparison-rover"' in text
    assert '"id":"nobg-ours"' in text


def test_a_rows_file_is_never_overwritten(tmp_path: Path, config: Path) -> None:
    file = write(
        tmp_path / "benchmarks" / "long" / "rows.json", [make_row(config, "rover", "ours", 0)]
    )
    before = file.read_bytes()
    with pytest.raises(InputError, match=r"rows\.json: the report would overwrite it"):
        compile_report([file], tmp_path)
    assert file.read_bytes() == before


def test_names_and_files_do_not_mix(tmp_path: Path, config: Path) -> None:
    for arguments in (["one", "two"], ["one", "--config", str(config)]):
        done = CliRunner().invoke(app, ["report", *arguments, "--out", str(tmp_path)])
        assert isinstance(done.exception, InputError)
        assert "rows.json files" in str(done.exception)


@pytest.mark.parametrize(
    "change", [{"benchmark": "../../../evil"}, {"artifacts": {"evaluate": "../../../secret"}}]
)
def test_rows_of_somebody_else_write_and_read_nothing_outside(
    tmp_path: Path, config: Path, change: Row
) -> None:
    """The benchmark's name is the report's folder; artifacts are linked, then shown."""
    theirs = tmp_path / "a" / "benchmarks" / "long" / "rows.json"
    (tmp_path / "secret").mkdir()
    write(theirs, [make_row(config, "rover", "3dgs", 0, **change)])
    out = tmp_path / "out" / "deep" / "deeper"
    (field,) = change
    with pytest.raises(InputError, match=f"rows.json: row 0: `{field}.*: expected .*, found '../"):
        compile_report([theirs], out)
    assert not list(tmp_path.rglob("report.html"))
    assert not out.exists()
