"""How far the regression gate can be trusted, by many real runs of a small benchmark.

    python benchmarks/gate_study.py scores OUT [--runs 320]
    python benchmarks/gate_study.py speed OUT [--runs 60]      # on a quiet machine
    python benchmarks/gate_study.py scores OUT --config benchmarks/quick-ci.toml --baseline quick-ci

**Scores.** Each run starts from points that are moved by a millionth of the scene: nothing that
anybody would see, and yet other bits, as a harmless edit of the code leaves them. The first runs
measure the noise that this makes (a baseline brings it); all others are compared, in pairs that
share no run, and each with one run, as CI compares with one baseline. Speeds are left out: each
candidate has its baseline's. Unchanged code on one machine gives the same bits, which is checked;
what is caught then is counted on the scores of one run, with other losses each time.

**Speed.** Runs from the same points on one machine: other points would train other splats, which
are faster or slower to draw. They end in the same bits, so that they are trained and measured
again, and scored once.

Every comparison is judged as it is, where each alarm is false, and with losses planted, which
differ from view to view and from capture to capture. With ``--baseline`` a committed baseline takes
the place of the one run, with its own noise; scores that are its own but for drawn noise are
counted too. ``--others`` adds the engine's other instruction sets, as another kind of machine.
Runs that lie in OUT are used, not repeated: an interrupted study goes on.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.gate_runs import Scenes, make_scenes, nudged, run, time_again, write_rows
from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import StageError
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.splat import _engine
from reports.gate import baseline, speed
from reports.gate.self_check import (
    CAUGHT_LEAST,
    FALSE_MOST,
    PLANTED,
    Comparison,
    Outcome,
    independent,
    rates_of,
)
from reports.rows.comparable import other_truth, reasons
from reports.rows.schema import Row, read_rows

HERE = Path(__file__).parent
OTHER_THREADS = 2
TIMED_ON = ("timed", "measured")
MEASURED = ("time", "fps", "calibration", "fps_calibrated", "fps_noise")
NOISE_RUNS = 20  # that measure the noise and are not compared
DRAWS = 300  # of losses, on scores of the same bits
Rows = Sequence[Row]


class Runs:
    """Runs of a benchmark on this machine, kept in a folder by kind and number."""

    def __init__(self, config: BenchmarkConfig, out: Path, *, small: bool) -> None:
        self.config, self.out, self.small = config, out / config.name, small
        self.out.mkdir(parents=True, exist_ok=True)
        self._scenes: list[tuple[Scene, MaskReport]] = []

    def read(self, kind: str, numbers: range) -> list[list[Row]]:
        """Return the runs of these numbers, ``scores`` or ``speed``; what is missing is run."""
        for number in numbers:
            path = self._path(kind, number)
            if not path.is_file():
                rows = self.timed() if kind == "speed" else self.one(number)
                write_rows(rows, path)
                if number % 20 == 0:
                    load = os.getloadavg()[0]
                    print(f"{kind} {number}: load average {load:.1f}", flush=True)
        return [sorted_rows(read_rows(self._path(kind, number))) for number in numbers]

    def _path(self, kind: str, number: int) -> Path:
        return self.out / f"{kind}-{number:04d}.json"

    def one(self, number: int) -> list[Row]:
        """Run all experiments once, from the points that ``number`` stands for."""
        with self._moved(number) as (scenes, out):
            return run(self.config, scenes, out)

    def timed(self) -> list[Row]:
        """Train and measure all experiments of run 0 again."""
        (rows,) = self.read("scores", range(1))
        with self._moved(0) as (scenes, out):
            return time_again(self.config, rows, scenes, out)

    @contextmanager
    def _moved(self, number: int) -> Iterator[tuple[Scenes, Path]]:
        self._scenes = self._scenes or make_scenes(self.config, self.out, 1, small=self.small)
        with tempfile.TemporaryDirectory(prefix="gate-study-") as folder:
            work = Path(folder)
            yield (
                [(nudged(s, work / s.name, number), masks) for s, masks in self._scenes],
                work / "runs",
            )

    def check_same_bits(self) -> None:
        """Repeat run 0; raises :class:`StageError` where its scores are others now."""
        (first,) = self.read("scores", range(1))
        for old, new in zip(first, sorted_rows(self.one(0)), strict=True):
            if new["per_view"] != old["per_view"]:
                raise StageError(f"{old['capture']} {old['condition']}: other bits when repeated")

    def elsewhere(self) -> list[list[Row]]:
        """Return a run by each other instruction set of the engine, as other machines round."""
        own, runs = _engine.instruction_set(), []
        for name in ("avx2", "baseline"):
            path = self.out / f"other-{name}.json"
            if not path.is_file() and name != own and _engine.use_instruction_set(name):
                scenes = make_scenes(self.config, self.out, OTHER_THREADS, small=self.small)
                rows = run(self.config, scenes, self.out / name)
                for row in rows:  # as another machine would say
                    row["provenance"]["cpu_kind"] = f"engine on {name}"
                write_rows(rows, path)
            if path.is_file():
                runs.append(read_rows(path))
        _engine.use_instruction_set(own)
        return runs


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


def check_comparable(pairs: Sequence[Comparison]) -> None:
    """Raise :class:`StageError` where rows do not compare: each would count as a missed loss."""
    for rows, others in pairs:
        for row, other in zip(rows, others, strict=True):
            for reason in reasons(row, other) + other_truth(row, other):
                raise StageError(f"{row['capture']} {row['condition']}: {reason}")


def sorted_rows(rows: Sequence[Row]) -> list[Row]:
    """Return rows by experiment."""
    return sorted(rows, key=lambda row: (row["capture"], row["condition"], row["seed"]))


def same_bits(pairs: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons with the baseline's scores in the candidate, and its own speed."""
    return [([timed_as(b, a) for a, b in zip(*pair, strict=True)], pair[1]) for pair in pairs]


def same_speed(pairs: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons with the baseline's speed in the candidate, and its own scores."""
    return [([timed_as(a, b) for a, b in zip(*pair, strict=True)], pair[1]) for pair in pairs]


def timed_as(row: Row, other: Row) -> Row:
    """Return a row with the speed, and the machine, of another."""
    metrics = row["metrics"] | {name: other["metrics"][name] for name in MEASURED}
    machine = {name: other["provenance"].get(name) for name in (*speed.MACHINE, *TIMED_ON)}
    provenance = row["provenance"] | machine
    return row | {"metrics": metrics, "repeats": other["repeats"], "provenance": provenance}


def drawn(rows: Rows, noise: Mapping[str, float], count: int) -> Iterator[list[Row]]:
    """Yield the rows with every score moved by its noise between two runs, normal, per row."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        yield [_moved(row, noise, rng) for row in rows]


def _moved(row: Row, noise: Mapping[str, float], rng: np.random.Generator) -> Row:
    shifts = {name: rng.normal(0, np.sqrt(2) * value) for name, value in sorted(noise.items())}
    views = [
        view | {n: view[n] + shifts[n] for n in shifts if view.get(n) is not None}
        for view in row["per_view"]
    ]
    ratios = {n: row["metrics"][n] * np.exp(shifts[n]) for n in ("size_mb", "splats") if n in noise}
    return row | {"per_view": views, "metrics": row["metrics"] | ratios}


def table(outcomes: Mapping[str, Outcome]) -> str:
    """Tabulate rates with their one-sided bounds at 95 %, and what was called worse falsely."""
    lines = [
        "| what | comparisons | false alarms | cannot judge | "
        + " | ".join(f"{name} caught" for name in PLANTED)
        + " |",
        "| --- |" + " --: |" * (3 + len(PLANTED)),
    ]
    for name, outcome in outcomes.items():
        alarms = outcome.false_alarms
        entries = [
            str(alarms.trials),
            f"{alarms.hits} (< {alarms.most:.1%})",
            f"{outcome.doubts.share:.1%}",
            *(f"{rate.share:.1%} (> {rate.least:.1%})" for rate in outcome.caught.values()),
        ]
        lines.append(f"| {name} | " + " | ".join(entries) + " |")
    named = {
        name: ", ".join(f"{k} {n}" for k, n in o.alarms.items()) for name, o in outcomes.items()
    }
    lines += ["", *(f"False alarms, {name}: {text}" for name, text in named.items() if text)]
    return "\n".join(lines)


def scores(runs: Runs, count: int, against: str | None, *, others: bool) -> dict[str, Outcome]:
    """Judge runs whose scores differ by rounding alone."""
    known = None if against is None else baseline.load(against)
    runs.check_same_bits()
    print("Repeated from the same points, run 0 gave the same bits.")
    first = 0 if known else NOISE_RUNS
    noise = known.noise if known else baseline.measured_noise(runs.read("scores", range(first)))
    print("\nNoise", ", ".join(f"{k} {v:.2g}" for k, v in noise.items()))
    compared = runs.read("scores", range(first, count))
    one = sorted_rows(known.rows) if known else compared[0]
    rest = compared if known else compared[1:]
    pairs, each = same_speed(independent(compared)), same_speed([(rows, one) for rows in rest])
    check_comparable(each)
    outcomes = {
        "the same bits": rates_of([(one, one)] * DRAWS, noise=noise),
        "other rounding, in pairs": rates_of(pairs, noise=noise),
        f"other rounding, against {against or 'one run'}": rates_of(each, noise=noise),
        "the same, noise not known": rates_of(each),
    }
    if known:
        moved = [(rows, one) for rows in drawn(one, noise, DRAWS)]
        outcomes[f"{against} moved by its noise"] = rates_of(moved, noise=noise)
    if others:
        elsewhere = same_speed([(rows, compared[0]) for rows in runs.elsewhere()])
        outcomes["other instruction sets"] = rates_of(elsewhere, noise=noise)
    return outcomes


def main() -> int:
    """Print the tables; exit 1 where the first line misses what is required of the gate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["scores", "speed"])
    parser.add_argument("out", type=Path, help="folder for the runs")
    parser.add_argument("--config", type=Path, default=HERE / "gate-study.toml")
    parser.add_argument("--runs", type=int, help="of the same code on this machine")
    parser.add_argument("--seeds", type=int, help="of each experiment; the file's without it")
    parser.add_argument("--first", type=int, help="only make the runs from this number on")
    parser.add_argument("--baseline", help="name of a committed baseline of the same benchmark")
    parser.add_argument("--others", action="store_true", help="other instruction sets too")
    options = parser.parse_args()
    config = load_toml(options.config)
    if options.seeds:
        config = config.model_copy(update={"seeds": tuple(range(options.seeds))})
    count = options.runs or {"scores": 320, "speed": 60}[options.what]
    # a committed baseline's truth is composited at the photos' own size
    runs = Runs(config, options.out, small=options.baseline is None)
    if options.first is not None:
        runs.read(options.what, range(options.first, count))
        return 0
    print(f"{count} runs of {config.name}, {options.what}\n")
    if options.what == "scores":
        outcomes = scores(runs, count, options.baseline, others=options.others)
    else:
        timed = runs.read("speed", range(count))
        print(speed_spread(timed))
        outcomes = {
            "speed, in pairs": rates_of(same_bits(independent(timed))),
            "speed, against one run": rates_of(same_bits([(rows, timed[0]) for rows in timed[1:]])),
        }
    print(f"\nOne-sided bounds at 95 % in brackets.\n\n{table(outcomes)}")
    outcome = next(iter(outcomes.values()))
    caught = min(rate.share for rate in outcome.caught.values())
    return 0 if outcome.false_alarms.most < FALSE_MOST and caught >= CAUGHT_LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
