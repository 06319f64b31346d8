"""Branches that fail never stop the others: rows say why, tables show holes, the exit code tells.

One capture has two photos only, another is noise, so that no view can be placed; on the third one
condition diverges at its first step, and one is healthy.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mattgs_ops
from reports.tables.tables import HOLE

PHOTOS = Path(mattgs_ops.__file__).parent / "bundled" / "lattepanda" / "images"
SETTINGS = """
name = "mixed"
iterations = 20
resolution = 64
conditions = ["nobg-3dgs", "nobg-wild"]
[methods.wild]
weighting = "residual"
weight = 1e39 # infinite as a 32-bit number
[[captures]]
name = "pair"
path = "pair"
[[captures]]
name = "noise"
path = "noise"
[[captures]]
name = "board"
path = "board"
[segment]
source = "none"
[sfm]
max_features = 1500
"""


FINISHED = ("board", "nobg-3dgs")
REASONS = {
    ("pair", "nobg-3dgs"): "found 2 photos; at least 3",
    ("pair", "nobg-wild"): "found 2 photos; at least 3",
    ("noise", "nobg-3dgs"): "none of 28 pairs of views shows the same scene",
    ("noise", "nobg-wild"): "none of 28 pairs of views shows the same scene",
    ("board", "nobg-wild"): "the loss is nan",
}


@pytest.mark.slow
def test_what_cannot_be_reconstructed_or_diverges_fails_alone(tmp_path: Path) -> None:
    write_captures(tmp_path)
    (tmp_path / "mixed.toml").write_text(SETTINGS)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "flows.cli.app", "run", "--out", str(out)]
    done = subprocess.run(
        [*command, "--config", str(tmp_path / "mixed.toml")],
        capture_output=True,
        text=True,
        timeout=540,
        check=False,
        # the locks that silence the machine are its own: benchmarks that run beside do not delay it
        env=os.environ | {"TMPDIR": str(tmp_path)},
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert done.stdout.strip().splitlines()[-1].startswith("Report: ")
    benchmark = out / "benchmarks" / "mixed"
    rows = json.loads((benchmark / "rows.json").read_text())
    by_cell = {(row["capture"], row["condition"]): row for row in rows}
    assert by_cell.keys() == {FINISHED, *REASONS}
    assert by_cell[FINISHED]["status"] == "finished", by_cell[FINISHED]["reason"]
    for cell, reason in REASONS.items():
        assert by_cell[cell]["status"] == "failed"
        assert reason in by_cell[cell]["reason"]
    assert all(row["run_id"] for row in rows), "failures are recorded too"
    report = (benchmark / "report.md").read_text()
    (table,) = re.findall(r"^### Table [^\n]*board.*?(?=^#)", report, re.MULTILINE | re.DOTALL)
    wild, healthy = (line_of(table, name) for name in ("wild", "3DGS"))
    assert set(wild[1:-1]) == {HOLE.text}  # the last column names the run
    assert HOLE.text not in healthy
    assert re.search(r"wild, seed 0 failed: .*the loss is nan", table)


def write_captures(folder: Path) -> None:
    rng = np.random.default_rng(3)
    for name in ("pair", "noise", "board"):
        (folder / name).mkdir()
    for index, path in enumerate(sorted(PHOTOS.glob("*.jpg"))[:8]):
        with Image.open(path) as photo:
            photo.resize((480, 360)).save(folder / "board" / path.name, quality=95)
        noise = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        Image.fromarray(noise).save(folder / "noise" / f"{index}.png")
    for name in ("0.png", "1.png"):
        shutil.copy(folder / "noise" / name, folder / "pair")


def line_of(table: str, method: str) -> list[str]:
    """Return the cells of a method's line in a Markdown table, from the method on."""
    lines = [line.split("|")[2:-1] for line in table.splitlines() if line.startswith("|")]
    (found,) = (cells for cells in lines if cells[0].strip().startswith(method))
    return [cell.strip() for cell in found]
