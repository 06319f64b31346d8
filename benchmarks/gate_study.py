"""How far the regression gate can be trusted: false alarms and what it catches, by noise.

    python benchmarks/gate_study.py                      simulated runs, a table by noise
    python benchmarks/gate_study.py RUN_A.json RUN_B.json   two real runs of the same code

A simulated grid has 12 cells (three captures, four conditions), one seed, six held-out views. Every
simulated run draws anew what two runs of the same code differ by: each view, each run as a whole,
each measurement of speed, and the number of splats.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mattgs_ops.config import BUNDLED, PAPER_CONDITIONS
from reports.gate import GateReport, Verdict, compare
from reports.rows import Row, read_rows
from reports.self_check import grow, lose_quality, lose_speed, self_check

COMPARISONS = 400
VIEWS = 6
TRUTH = {"psnr": 26.0, "ssim": 0.88, "l1": 0.03}  # of a cell, before noise; in mask alike
PER_DECIBEL = {"psnr": 1.0, "ssim": 0.01, "l1": 0.002}  # noise is stated in dB and scaled


@dataclass(frozen=True)
class Noise:
    """Standard deviations between two runs of the same code."""

    view: float  # dB, one view
    run: float  # dB, a whole run of one cell
    speed: float  # share, one calibrated measurement
    repeats: int
    splats: float  # share


def run(noise: Noise, rng: np.random.Generator) -> list[Row]:
    """Draw one run of the grid."""
    return [
        _row(capture, condition, noise, rng)
        for capture in BUNDLED
        for condition in PAPER_CONDITIONS
    ]


def _row(capture: str, condition: str, noise: Noise, rng: np.random.Generator) -> Row:
    background, _, method = condition.partition("-")
    whole = rng.normal(0, noise.run)
    views = []
    for index in range(VIEWS):
        shift = whole + rng.normal(0, noise.view)
        scores = {
            prefix + name: value + index * 0.3 * PER_DECIBEL[name] + shift * PER_DECIBEL[name]
            for name, value in TRUTH.items()
            for prefix in ("", "mask_")
        }
        views.append({"view": f"{index:04d}.jpg", "split": "test", **scores})
    measured = {
        name: [
            {"value": base * np.exp(rng.normal(0, noise.speed)), "calibration": 0.5}
            for _ in range(noise.repeats)
        ]
        for name, base in (("time", 60.0), ("fps", 80.0))
    }
    size = 4.0 * np.exp(rng.normal(0, noise.splats))
    means = {name: float(np.mean([view[name] for view in views])) for name in scores}
    metrics = means | {
        "loss": 0.05,
        "time": measured["time"][0]["value"],
        "fps": measured["fps"][0]["value"],
        "size_mb": size,
        "splats": round(size * 4000),
    }
    return {
        "schema": 1,
        "benchmark": "study",
        "capture": capture,
        "condition": condition,
        "background": background,
        "method": method,
        "seed": 0,
        "iterations": 1000,
        "resolution": 320,
        "status": "finished",
        "reason": None,
        "metrics": metrics,
        "per_view": views,
        "repeats": measured,
        "registration": {"registered": 48, "views": 48},
        "masks": {"mean_iou": 0.95},
        "provenance": {"config_digest": "study", "calibration": 0.5, "inputs": {}},
        "artifacts": {},
    }


def rates(noise: Noise, comparisons: int, seed: int) -> dict[str, float]:
    """Return shares of fresh pairs of runs: false alarms, and plants that were caught."""
    rng = np.random.default_rng(seed)
    plants: dict[str, tuple[Callable[[Row], Row], str | None]] = {
        "false": (lambda row: row, None),
        "0.3 dB": (lose_quality, "quality"),
        "10 % slower": (lose_speed, "cost"),
        "10 % larger": (grow, "size"),
    }
    hits = dict.fromkeys(plants, 0)
    for _ in range(comparisons):
        old, new = run(noise, rng), run(noise, rng)
        for name, (plant, aspect) in plants.items():
            hits[name] += _alarmed(compare([plant(row) for row in new], old), aspect)
    return {name: count / comparisons for name, count in hits.items()}


def _alarmed(report: GateReport, aspect: str | None) -> bool:
    return any(
        finding.verdict == Verdict.WORSE and aspect in (None, finding.aspect)
        for finding in report.findings
    )


STUDY = (
    Noise(view=0.0, run=0.0, speed=0.01, repeats=1, splats=0.0),
    Noise(view=0.02, run=0.01, speed=0.02, repeats=1, splats=0.002),
    Noise(view=0.05, run=0.02, speed=0.03, repeats=1, splats=0.005),
    Noise(view=0.05, run=0.02, speed=0.05, repeats=3, splats=0.005),
    Noise(view=0.10, run=0.03, speed=0.05, repeats=5, splats=0.01),
    Noise(view=0.20, run=0.05, speed=0.10, repeats=9, splats=0.01),
)


def main() -> int:
    """Print the table; exit 1 where the gate may not be trusted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", type=Path, help="two files of rows of the same code")
    parser.add_argument("--comparisons", type=int, default=COMPARISONS)
    options = parser.parse_args()
    if options.runs:
        first, second = (read_rows(path) for path in options.runs)
        found = self_check(first, second, comparisons=options.comparisons)
        print("| comparisons | false alarms | 0.3 dB | 10 % slower | 10 % larger |")
        print("| --: | --: | --: | --: | --: |")
        shares = (found.false_alarms, found.caught_quality, found.caught_speed, found.caught_size)
        print(f"| {found.comparisons} | " + " | ".join(f"{s:.1%}" for s in shares) + " |")
        return 0 if found.trusted else 1
    print(
        "| view, dB | run, dB | speed | repeats | splats | comparisons | false alarms "
        "| 0.3 dB caught | 10 % slower caught | 10 % larger caught |"
    )
    print("|" + " --: |" * 10)
    for index, noise in enumerate(STUDY):
        found_rates = rates(noise, options.comparisons, seed=index)
        shares_text = " | ".join(f"{share:.1%}" for share in found_rates.values())
        print(
            f"| {noise.view} | {noise.run} | {noise.speed:.0%} | {noise.repeats} "
            f"| {noise.splats:.1%} | {options.comparisons} | {shares_text} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
