"""How far the regression gate can be trusted, by real runs of a small benchmark.

    python benchmarks/gate_study.py OUT [--config benchmarks/quick-ci.toml] [--runs 4] [--seeds 0]

The benchmark runs several times with the same code on this machine, then with the engine's other
instruction sets and points found by several threads, as another machine would round. Each family of
runs is resampled into many A/A comparisons: false alarms are counted, and what is caught of planted
losses of 0.3 dB, 10 % speed and 10 % size. Runs that lie in OUT are used, not repeated.
"""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.gate_runs import experiment, make_scene, write_rows
from flows.grid import cells
from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import BenchmarkConfig, load_toml
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.splat import _engine
from reports.gate import baseline, speed
from reports.gate.planted import lose_quality, lose_speed
from reports.gate.self_check import caught_by_size, self_check, told
from reports.rows.schema import Row, read_rows

COMPARISONS = 400
OTHER_THREADS = 2


def run(
    config: BenchmarkConfig, scenes: Sequence[tuple[Scene, MaskReport]], out: Path
) -> list[Row]:
    """Run all experiments once."""
    return [
        experiment(config, cell, *scene, out / f"{cell.capture}-{cell.condition}-{cell.seed}")
        for capture, scene in zip(config.captures, scenes, strict=True)
        for cell in cells(config, capture.name)
    ]


def runs_of(config: BenchmarkConfig, out: Path, count: int) -> tuple[list[list[Row]], list[Path]]:
    """Return the runs on this machine, and the files of those that round otherwise."""
    own = _engine.instruction_set()
    plan = [(f"same-{k}", own, 1) for k in range(count)]
    plan += [
        (f"other-{name}", name, OTHER_THREADS)
        for name in ("avx2", "baseline")
        if name != own and _engine.use_instruction_set(name)
    ]
    made: dict[int, list[tuple[Scene, MaskReport]]] = {}
    for name, instructions, threads in plan:
        path = out / f"{name}.json"
        if path.is_file():
            continue
        if threads not in made:
            made[threads] = [
                make_scene(capture, config, out / f"{capture.name}-{threads}", threads=threads)
                for capture in config.captures
            ]
        _engine.use_instruction_set(instructions)
        load = os.getloadavg()[0]
        rows = run(config, made[threads], out / name)
        if instructions != own:  # as another machine would say
            for row in rows:
                row["provenance"]["cpu_kind"] = f"engine on {instructions}"
        write_rows(rows, path)
        print(f"run {name}: load average {load:.1f} to {os.getloadavg()[0]:.1f}", flush=True)
    _engine.use_instruction_set(own)
    files = [out / f"{name}.json" for name, _, _ in plan]
    same = [read_rows(path) for path in files if path.name.startswith("same")]
    return same, [path for path in files if path.name.startswith("other")]


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


def losses(
    runs: Sequence[Sequence[Row]], aspect: str, comparisons: int, noise: Mapping[str, float]
) -> str:
    """Tabulate what share of losses of several sizes is caught."""
    quality = aspect == "quality"
    sizes = (0.3, 0.5, 0.75, 1.0) if quality else (0.1, 0.2, 0.5, 1.0)
    plants = (
        [partial(lose_quality, decibels=size) for size in sizes]
        if quality
        else [partial(lose_speed, share=size) for size in sizes]
    )
    found = caught_by_size(runs, aspect, plants, comparisons=comparisons, noise=noise)
    names = [f"{size} dB" if quality else f"{size:.0%} slower" for size in sizes]
    shares = [f"{share:.1%}" for share in found]
    lines = [["planted", *names], ["---", *["--:"] * len(sizes)], ["caught", *shares]]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _log_speed(row: Row, metric: str) -> float:
    return float(np.median(np.log(list(speed.calibrated(row, metric).values()))))


def main() -> int:
    """Print the tables; exit 1 where the gate may not be trusted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder for the runs")
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name("quick-ci.toml"))
    parser.add_argument("--runs", type=int, default=4, help="of the same code on this machine")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--comparisons", type=int, default=COMPARISONS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    config = load_toml(options.config).model_copy(update={"seeds": tuple(options.seeds)})
    same, others = runs_of(config, options.out, options.runs)
    print(f"\n{len(same)} runs on one machine, {len(same[0])} experiments each\n")
    print(speed_spread(same))
    found = self_check(same, comparisons=options.comparisons)
    print(f"\nOne machine. {told(found)}")
    print("\n" + losses(same, "cost", options.comparisons // 2, {}))
    if others:
        unlike = [same[0], *(read_rows(path) for path in others)]
        noise = baseline.measured_noise(unlike)
        print("\nAnother machine: noise", ", ".join(f"{k} {v:.2g}" for k, v in noise.items()))
        print("\n" + told(self_check(unlike, comparisons=options.comparisons, noise=noise)))
        print("\n" + losses(unlike, "quality", options.comparisons // 2, noise))
    return 0 if found.trusted else 1


if __name__ == "__main__":
    sys.exit(main())
