"""One branch that fails never stops the others: its rows say why, and the exit code tells."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mattgs_ops

PHOTOS = Path(mattgs_ops.__file__).parent / "bundled" / "lattepanda" / "images"
SETTINGS = """
name = "mixed"
iterations = 20
resolution = 64
conditions = ["nobg-3dgs"]
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


@pytest.mark.slow
def test_a_capture_that_cannot_be_reconstructed_fails_alone(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for name in ("noise", "board"):
        (tmp_path / name).mkdir()
    for index, path in enumerate(sorted(PHOTOS.glob("*.jpg"))[:8]):
        with Image.open(path) as photo:
            photo.resize((480, 360)).save(tmp_path / "board" / path.name, quality=95)
        noise = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        Image.fromarray(noise).save(tmp_path / "noise" / f"{index}.png")
    (tmp_path / "mixed.toml").write_text(SETTINGS)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "flows.cli", "run", "--out", str(out)]
    done = subprocess.run(
        [*command, "--config", str(tmp_path / "mixed.toml")],
        capture_output=True,
        text=True,
        timeout=540,
        check=False,
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert done.stdout.strip().splitlines()[-1].startswith("Report: ")
    rows = json.loads((out / "benchmarks" / "mixed" / "rows.json").read_text())
    by_capture = {row["capture"]: row for row in rows}
    assert by_capture["board"]["status"] == "finished", by_capture["board"]["reason"]
    assert by_capture["board"]["run_id"]
    assert by_capture["noise"]["status"] == "failed"
    assert "none of 28 pairs of views shows the same scene" in by_capture["noise"]["reason"]
    assert by_capture["noise"]["run_id"], "failures are recorded too"
