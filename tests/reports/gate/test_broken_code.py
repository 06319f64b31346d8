"""Regressions planted into the real code, found by the gate on rows of real trainings.

A tiny benchmark (24 photos of a bundled board at 64 px, started from its visual hull and from
random points about it) runs through the functions that the stages call. Then something is broken,
the experiments that it touches run again, and the gate must name it: the right verdict, on the
right metric, in the right cells.
"""

import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks import gate_runs
from mattgs_ops.capture.scene import Scene
from mattgs_ops.score import speed
from mattgs_ops.segment import infer
from mattgs_ops.splat import render as rendering
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import render
from mattgs_ops.splat.training import trainer
from reports.gate.compare import compare
from reports.gate.findings import ALL_CELLS, Exit, GateReport, Verdict
from reports.gate.self_check import self_check
from reports.rows.schema import Row
from tasks.stages.stage import Cell
from tests.reports.tiny_board import AGAIN, CELLS, SLEEP, SPEED, Line, Planted

pytestmark = pytest.mark.slow  # trains its cells, and measures their speed


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Planted:
    """Return the line and the rows of its healthy code."""
    with pytest.MonkeyPatch.context() as quick:
        quick.setattr(speed, "FEWEST_SECONDS", 0.4)
        line = Line(tmp_path_factory.mktemp("planted"))
        return line, [line.run(cell) for cell in CELLS]


def again(planted: Planted, touched: Callable[[Cell], bool], **more: Any) -> list[Row]:
    """Run the touched experiments anew; their speed, which nothing here changed, stays."""
    line, old = planted
    rows = []
    for cell, before in zip(CELLS, old, strict=True):
        row = before
        if touched(cell):
            speed = {name: before["metrics"][name] for name in SPEED}
            row = line.run(cell, speed=speed, **more)
            row["repeats"] = before["repeats"]
        rows.append(row)
    return rows


def worse(report: GateReport) -> set[tuple[str, str]]:
    """Return (capture/condition, metric) of all that is worse."""
    return {
        (finding.cell.partition("@")[0], finding.metric)
        for finding in report.findings
        if finding.verdict == Verdict.WORSE
    }


def test_a_wrong_learning_rate_is_worse_in_quality(
    planted: Planted, monkeypatch: pytest.MonkeyPatch
) -> None:
    healthy = trainer.Trainer.__init__

    def timid(self: trainer.Trainer, *arguments: Any) -> None:
        healthy(self, *arguments)
        self._fixed_rates = {name: rate / 20 for name, rate in self._fixed_rates.items()}

    monkeypatch.setattr(trainer.Trainer, "__init__", timid)
    report = compare(again(planted, lambda _: True), planted[1])
    assert report.exit_code == Exit.REGRESSION
    found = worse(report)
    assert {(ALL_CELLS, "psnr"), (ALL_CELLS, "mask_psnr"), (ALL_CELLS, "ssim")} <= found
    assert not {metric for _, metric in found} & {"time", "fps", "size_mb", "splats", "mean_iou"}


def test_inverted_attention_is_worse_where_attention_is_used(
    planted: Planted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Flat parts then pass for detail, so that their splats are spared; scores hardly show it."""
    healthy = trainer.Trainer.attention
    monkeypatch.setattr(trainer.Trainer, "attention", lambda *given: 1 - healthy(*given))
    # healthy 3DGS asks for no attention, and so gives the same bits
    report = compare(again(planted, lambda cell: cell.condition.startswith("original")), planted[1])
    assert report.exit_code == Exit.REGRESSION
    found = worse(report)
    assert {("board/original-ours", "splats"), ("board/original-ours", "size_mb")} <= found
    assert {cell for cell, _ in found} == {"board/original-ours"}
    others = [f for f in report.findings if f.cell.startswith("board/original-3dgs")]
    assert {f.verdict for f in others if f.aspect in ("quality", "size")} == {Verdict.SAME}


def test_a_leaked_test_view_is_not_comparable(
    planted: Planted, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, old = planted
    healthy = Scene.registered

    def leaking(self: Scene, split: Any) -> Any:
        leaked = healthy(self, "test")[:1] if split == "train" else ()
        return (*(replace(view, split="train") for view in leaked), *healthy(self, split))

    monkeypatch.setattr(Scene, "registered", leaking)
    report = compare(again(planted, lambda cell: cell == CELLS[0]), old)
    assert report.exit_code == Exit.CANNOT_JUDGE
    told = [f for f in report.findings if f.verdict == Verdict.NOT_COMPARABLE]
    assert [f.cell.partition("@")[0] for f in told] == ["board/original-3dgs"]
    assert "held-out views were trained on: 0000.jpg" in told[0].reason


def test_dilated_masks_are_worse_in_their_iou(
    planted: Planted, monkeypatch: pytest.MonkeyPatch
) -> None:
    line, old = planted
    healthy = infer._without_network
    reach = np.ones((11, 11), np.uint8)  # five pixels to each side
    monkeypatch.setattr(
        infer, "_without_network", lambda *given: cv2.dilate(healthy(*given), reach)
    )
    wide = line.cut_out()
    assert line.masks.mean_iou == 1
    rows = [row | {"masks": row["masks"] | {"mean_iou": wide.mean_iou}} for row in old]
    report = compare(rows, old)
    assert report.exit_code == Exit.REGRESSION
    assert {metric for _, metric in worse(report)} == {"mean_iou"}


def test_a_dropped_capture_is_newly_failing(planted: Planted) -> None:
    line, old = planted
    speed = {name: old[0]["metrics"][name] for name in SPEED}
    report = compare(old, [*old, line.run(AGAIN, speed=speed)])
    assert report.exit_code == Exit.FAILED_RUNS
    told = [f for f in report.findings if f.verdict == Verdict.NEWLY_FAILING]
    assert [(f.cell.partition("@")[0], f.metric) for f in told] == [
        ("again/original-3dgs", "status")
    ]


def test_a_sleep_in_the_rasteriser_is_worse_in_speed(
    planted: Planted, monkeypatch: pytest.MonkeyPatch
) -> None:
    line, old = planted
    healthy = render

    def sleepy(*arguments: Any, **more: Any) -> Any:
        began = time.perf_counter()
        found = healthy(*arguments, **more)
        # the second part is more than what neighbours take from a training's step
        time.sleep(SLEEP * (time.perf_counter() - began) + 0.02)
        return found

    monkeypatch.setattr(rendering, "render", sleepy)
    monkeypatch.setattr(trainer, "render", sleepy)
    monkeypatch.setattr(speed, "FEWEST_SECONDS", 0.4)
    report = compare([line.run(cell) for cell in CELLS], old)
    assert report.exit_code == Exit.REGRESSION
    found = worse(report)
    cells = {f"{cell.capture}/{cell.condition}" for cell in CELLS}
    assert {(cell, metric) for cell in cells for metric in ("fps", "time")} <= found
    assert {metric for _, metric in found} == {"fps", "time"}


def test_twice_the_splats_are_worse_in_size(planted: Planted) -> None:
    line, old = planted
    rows = []
    for cell, before in zip(CELLS, old, strict=True):
        out = line.root / before["artifacts"]["train"]
        twice = line.root / f"twice-{cell.capture}-{cell.condition}"
        twice.mkdir()
        write_ply(doubled(read_ply(out / "splats.ply")), twice / "splats.ply")
        shutil.copy(out / "training.json", twice)  # it names the photos that were trained on
        speed = {name: before["metrics"][name] for name in SPEED}
        laps = before["repeats"]["time"]
        row = gate_runs.evaluated(
            line.config, cell, line.scene, line.masks, twice, laps=laps, speed=speed
        )
        rows.append(row)
    report = compare(rows, old)
    assert report.exit_code == Exit.REGRESSION
    cells = {f"{cell.capture}/{cell.condition}" for cell in CELLS} | {ALL_CELLS}
    sizes = {(cell, metric) for cell in cells for metric in ("size_mb", "splats")}
    assert sizes <= worse(report)


def doubled(splats: Splats) -> Splats:
    """Return every splat twice."""
    once = vars(splats).items()
    return Splats(**{name: value.repeat(2, *[1] * (value.ndim - 1)) for name, value in once})


def test_the_gate_may_be_trusted_on_such_runs(planted: Planted) -> None:
    """The study of ``benchmarks/gate_study.py``, small: the quality that real trainings leave."""
    _, old = planted
    found = self_check([old, old], comparisons=24)
    assert found.resampled.false_alarms.hits == 0
    caught = found.resampled.caught
    assert min(caught["0.3 dB"].share, caught["10% larger"].share) >= 0.95
