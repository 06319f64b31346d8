"""How far the regression gate can be trusted, by many real runs of a small benchmark.

    python benchmarks/gate_study.py OUT [--config benchmarks/gate-study.toml] [--runs 600]

Each run starts from points that are moved by a millionth of the scene: nothing that anybody would
see, and yet other bits, as a harmless edit of the code leaves them. Runs are compared in pairs that
share none, so that every comparison is independent: once with the scores of the same bits and only
speed measured anew (unchanged code on one machine), once as they are (code that rounds otherwise).
False alarms are counted, and what is caught of planted losses. With ``--baseline`` each run's speed
is also judged against that baseline, as CI does. With ``--others`` the engine's other instruction
sets run too, as another kind of machine, and their noise is printed. Runs that lie in OUT are used,
not repeated: an interrupted study goes on.
"""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.gate_runs import experiment, make_scene, write_rows
from flows.grid import cells
from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.config_file import load_toml
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.splat import _engine
from reports.gate import baseline, speed
from reports.gate.planted import lose_quality, lose_speed
from reports.gate.self_check import (
    PLANTED,
    Comparison,
    Outcome,
    caught_by_size,
    independent,
    self_check,
    told,
    tried,
)
from reports.rows.schema import Row, read_rows

HERE = Path(__file__).parent
NUDGE = 1e-6  # of the points' spread
OTHER_THREADS = 2
MEASURED = ("time", "fps", "calibration", "fps_calibrated", "fps_noise")
Scenes = Sequence[tuple[Scene, MaskReport]]


def run(config: BenchmarkConfig, scenes: Scenes, out: Path) -> list[Row]:
    """Run all experiments once."""
    return [
        experiment(config, cell, *scene, out / f"{cell.capture}-{cell.condition}-{cell.seed}")
        for capture, scene in zip(config.captures, scenes, strict=True)
        for cell in cells(config, capture.name)
    ]


def nudged(scene: Scene, folder: Path, seed: int) -> Scene:
    """Return the scene with its points moved by a millionth, kept in ``folder``."""
    points = scene.points()
    step = NUDGE * points.xyz.std()
    moved = points.xyz + np.random.default_rng(seed).normal(0, step, points.xyz.shape)
    folder.mkdir(parents=True)
    shutil.copy(scene.folder / "scene.json", folder)  # the training's digest reads it
    np.savez(folder / "points.npz", **vars(replace(points, xyz=moved)))
    return replace(scene, folder=folder)


def runs_here(config: BenchmarkConfig, out: Path, count: int) -> list[list[Row]]:
    """Return so many runs on this machine; those that lie in ``out`` are read."""
    scenes: list[tuple[Scene, MaskReport]] = []
    for number in range(count):
        path = out / f"run-{number:04d}.json"
        if path.is_file():
            continue
        scenes = scenes or made(config, out, 1)
        with tempfile.TemporaryDirectory(prefix="gate-study-") as folder:
            work = Path(folder)
            moved = [(nudged(s, work / s.name, number), masks) for s, masks in scenes]
            write_rows(run(config, moved, work / "runs"), path)
        if number % 20 == 0:
            print(f"run {number}: load average {os.getloadavg()[0]:.1f}", flush=True)
    return [read_rows(out / f"run-{number:04d}.json") for number in range(count)]


def made(config: BenchmarkConfig, out: Path, threads: int) -> list[tuple[Scene, MaskReport]]:
    """Return the captures' scenes, made with so many threads."""
    return [
        make_scene(capture, config, out / f"{capture.name}-{threads}", threads=threads)
        for capture in config.captures
    ]


def runs_elsewhere(config: BenchmarkConfig, out: Path) -> list[list[Row]]:
    """Return a run by each other instruction set of the engine, as another machine would round."""
    own, found = _engine.instruction_set(), []
    for name in ("avx2", "baseline"):
        path = out / f"other-{name}.json"
        if not path.is_file() and name != own and _engine.use_instruction_set(name):
            rows = run(config, made(config, out, OTHER_THREADS), out / name)
            for row in rows:  # as another machine would say
                row["provenance"]["cpu_kind"] = f"engine on {name}"
            write_rows(rows, path)
        if path.is_file():
            found.append(read_rows(path))
    _engine.use_instruction_set(own)
    return found


def speed_spread(runs: Sequence[Sequence[Row]]) -> str:
    """Tabulate how speeds of the same experiment differ between runs, raw and calibrated."""
    raw: dict[str, Callable[[Row], float]] = {
        "time": lambda row: float(np.log(row["seconds"]["train"])),
        "fps": lambda row: float(np.log(row["metrics"]["fps"])),
    }
    lines = [
        "| speed | raw, spread | calibrated, spread | largest shift of a whole run |",
        "| --- |" + " --: |" * 3,
    ]
    for metric, plain in raw.items():
        table = np.array([[plain(row) for row in rows] for rows in runs])
        steady = np.array([[_log_speed(row, metric) for row in rows] for rows in runs])
        shift = max(abs((a - b).mean()) for a, b in combinations(steady, 2))
        shares = [table.std(axis=0, ddof=1).mean(), steady.std(axis=0, ddof=1).mean(), shift]
        lines.append(f"| {metric} | " + " | ".join(f"{share:.1%}" for share in shares) + " |")
    return "\n".join(lines)


def _log_speed(row: Row, metric: str) -> float:
    return float(np.median(np.log(list(speed.calibrated(row, metric).values()))))


def same_bits(pairs: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons with the baseline's scores in the candidate, and its own speed."""
    return [([timed_as(b, a) for a, b in zip(*pair, strict=True)], pair[1]) for pair in pairs]


def timed_as(row: Row, other: Row) -> Row:
    """Return a row with the speed, and the machine, of another."""
    metrics = row["metrics"] | {name: other["metrics"][name] for name in MEASURED}
    origin = row["provenance"] | {name: other["provenance"].get(name) for name in speed.MACHINE}
    return row | {"metrics": metrics, "repeats": other["repeats"], "provenance": origin}


def table(outcomes: Mapping[str, Outcome]) -> str:
    """Tabulate rates with their bounds."""
    lines = [
        "| what | comparisons | false alarms | cannot judge | "
        + " | ".join(f"{name} caught" for name in PLANTED)
        + " |",
        "| --- |" + " --: |" * (3 + len(PLANTED)),
    ]
    for name, found in outcomes.items():
        alarms = found.false_alarms
        cells = [
            str(alarms.trials),
            f"{alarms.hits} (< {alarms.most:.1%})",
            f"{found.doubts.share:.1%}",
            *(f"{rate.share:.1%} (> {rate.least:.1%})" for rate in found.caught.values()),
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def losses(
    runs: Sequence[Sequence[Row]], aspect: str, comparisons: int, noise: Mapping[str, float]
) -> str:
    """Tabulate what share of losses of several sizes is caught."""
    sizes = (0.3, 0.5, 0.75, 1.0) if aspect == "quality" else (0.1, 0.2, 0.5, 1.0)

    def plant(row: Row, draw: int, size: float) -> Row:
        return lose_quality(row, size, draw=draw) if aspect == "quality" else lose_speed(row, size)

    plants = [partial(plant, size=size) for size in sizes]
    found = caught_by_size(runs, aspect, plants, comparisons=comparisons, noise=noise)
    names = [f"{size} dB" if aspect == "quality" else f"{size:.0%} slower" for size in sizes]
    shares = [f"{share:.1%}" for share in found]
    lines = [["planted", *names], ["---", *["--:"] * len(sizes)], ["caught", *shares]]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main() -> int:
    """Print the tables; exit 1 where the gate may not be trusted on one machine."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder for the runs")
    parser.add_argument("--config", type=Path, default=HERE / "gate-study.toml")
    parser.add_argument("--runs", type=int, default=600, help="of the same code on this machine")
    parser.add_argument("--baseline", help="name of a committed baseline of the same benchmark")
    parser.add_argument("--others", action="store_true", help="other instruction sets too")
    parser.add_argument("--comparisons", type=int, default=200, help="resampled, with --others")
    options = parser.parse_args()
    config = load_toml(options.config)
    out = options.out / config.name
    out.mkdir(parents=True, exist_ok=True)
    runs = runs_here(config, out, options.runs)
    print(f"\n{len(runs)} runs of {config.name} on one machine, {len(runs[0])} experiments each\n")
    print(speed_spread(runs))
    pairs = independent(runs)
    outcomes = {"the same bits": tried(same_bits(pairs)), "rounded otherwise": tried(pairs)}
    if options.baseline:
        known = list(baseline.load(options.baseline).rows)
        outcomes[f"against {options.baseline}"] = tried(same_bits([(r, known) for r in runs]))
    print(f"\nIndependent comparisons, 95 % bounds in brackets.\n\n{table(outcomes)}")
    if options.others:
        unlike = [runs[0], *runs_elsewhere(config, out)]
        noise = baseline.measured_noise(unlike)
        print("\nAnother machine: noise", ", ".join(f"{k} {v:.2g}" for k, v in noise.items()))
        print("\n" + told(self_check(unlike, comparisons=options.comparisons, noise=noise)))
        print("\n" + losses(unlike, "quality", options.comparisons, noise))
    found = outcomes["the same bits"]
    caught = min(rate.share for rate in found.caught.values())
    return 0 if found.false_alarms.most < 0.01 and caught >= 0.95 else 1


if __name__ == "__main__":
    sys.exit(main())
