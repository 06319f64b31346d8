"""Rows reach the file in batches, and a resumed run goes on where its checkpoint was."""

import csv
from pathlib import Path

from mattgs_ops.splat.training.curve import BATCH, Curve, CurveRow, due


def row(step: int) -> CurveRow:
    return CurveRow(step, 0.5 / step, 0.25, 0.75, 20.0, 100 * step, 123.456789, 21.5)


def read(folder: Path) -> list[dict[str, str]]:
    with (folder / "curve.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_rows_are_written_in_batches_and_at_the_end(tmp_path: Path) -> None:
    curve = Curve(tmp_path, 0)
    for step in range(1, BATCH + 6):
        curve.add(row(step))
    assert len(read(tmp_path)) == BATCH
    curve.flush()
    rows = read(tmp_path)
    assert [int(r["step"]) for r in rows] == list(range(1, BATCH + 6))
    assert rows[2] == {
        "step": "3",
        "loss": "0.166667",
        "l1": "0.25",
        "ssim": "0.75",
        "psnr": "20",
        "splats": "300",
        "steps_per_second": "123.457",
        "fixed_psnr": "21.5",
    }


def test_resuming_drops_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    first = Curve(tmp_path, 0)
    for step in range(1, 9):
        first.add(row(step))
    first.flush()
    with (tmp_path / "curve.csv").open("a") as file:
        file.write("9,0.1")  # killed while writing
    second = Curve(tmp_path, 5)
    second.add(row(6))
    second.flush()
    assert [int(r["step"]) for r in read(tmp_path)] == [1, 2, 3, 4, 5, 6]


def test_a_new_run_forgets_an_old_curve(tmp_path: Path) -> None:
    old = Curve(tmp_path, 0)
    old.add(row(1))
    old.flush()
    Curve(tmp_path, 0)
    assert read(tmp_path) == []


def test_a_run_has_some_fifty_to_two_hundred_rows() -> None:
    rows = {1: 1, 7: 7, 150: 51, 1000: 51, 7000: 201, 30_000: 201}
    for iterations, expected in rows.items():
        steps = [s for s in range(1, iterations + 1) if due(s, iterations)]
        assert len(steps) == expected
        assert steps[0] == 1
        assert steps[-1] == iterations
