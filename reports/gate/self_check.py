"""The gate tried on itself: how often unchanged code alarms it, how often a planted loss escapes.

Runs of the same code are resampled into many A/A comparisons. Which run is called candidate and
which baseline is drawn for a comparison as a whole in one half of them, so that what all cells of a
run share stays shared, and for each experiment anew in the other half; held-out views are drawn
with replacement. Nothing changed, so whatever is called worse is a false alarm. The same
comparisons with a loss planted into the candidate show what the gate catches.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mattgs_ops.errors import InputError
from reports.gate.compare import compare
from reports.gate.findings import Exit, GateReport, Verdict
from reports.gate.planted import EVERYWHERE, GROWTH, SLOWDOWN, grow, lose_quality, lose_speed
from reports.rows.schema import Row, key_of, refused

LEAST = 200  # comparisons from which a rate of 1 % is worth stating
FALSE_MOST, CAUGHT_LEAST = 0.01, 0.95
Experiments = dict[object, Row]


@dataclass(frozen=True)
class SelfCheck:
    """Shares of comparisons: ``false_alarms`` and ``doubts`` (exit code 2) without a change.

    The others are of comparisons with one planted.
    """

    comparisons: int
    false_alarms: float
    doubts: float
    caught_quality: float
    caught_speed: float
    caught_size: float

    @property
    def trusted(self) -> bool:
        """Whether the gate may be trusted on such rows: under 1 % false, at least 95 % caught."""
        caught = min(self.caught_quality, self.caught_speed, self.caught_size)
        return self.false_alarms < FALSE_MOST and caught >= CAUGHT_LEAST


def told(found: SelfCheck) -> str:
    """Return the outcome as a Markdown table with a sentence on top."""
    verdict = "may" if found.trusted else "may not"
    plants = f"{EVERYWHERE} dB caught | {SLOWDOWN:.0%} slower caught | {GROWTH:.0%} larger caught"
    shares = (
        found.false_alarms,
        found.doubts,
        found.caught_quality,
        found.caught_speed,
        found.caught_size,
    )
    return "\n".join(
        [
            (
                f"Self-check: the gate {verdict} be trusted on such runs "
                f"(required: under {FALSE_MOST:.0%} false, at least {CAUGHT_LEAST:.0%} caught)."
            ),
            "",
            f"| A/A comparisons | false alarms | cannot judge | {plants} |",
            "| --: | --: | --: | --: | --: | --: |",
            f"| {found.comparisons} | " + " | ".join(f"{share:.1%}" for share in shares) + " |",
        ]
    )


def self_check(
    runs: Sequence[Sequence[Row]],
    *,
    comparisons: int = LEAST,
    seed: int = 0,
    noise: Mapping[str, float] | None = None,
) -> SelfCheck:
    """Judge the gate by two or more runs of the same code; :class:`InputError` for unlike runs.

    ``noise`` is a baseline's.
    """
    experiments = _experiments(runs)
    rng = np.random.default_rng(seed)
    drawn = [resample(experiments, rng) for _ in range(comparisons)]

    def reports(plant: Callable[[Row], Row]) -> list[GateReport]:
        return [compare([plant(row) for row in new], old, noise=noise) for new, old in drawn]

    def rate(alarmed: Callable[[GateReport], bool], found: Sequence[GateReport]) -> float:
        return float(np.mean([alarmed(report) for report in found]))

    unchanged = reports(lambda row: row)
    return SelfCheck(
        comparisons,
        rate(_worse(None), unchanged),
        rate(lambda report: report.exit_code == Exit.CANNOT_JUDGE, unchanged),
        rate(_worse("quality"), reports(lose_quality)),
        rate(_worse("cost"), reports(lose_speed)),
        rate(_worse("size"), reports(grow)),
    )


def caught_by_size(
    runs: Sequence[Sequence[Row]],
    aspect: str,
    plants: Sequence[Callable[[Row], Row]],
    *,
    comparisons: int = LEAST,
    seed: int = 0,
    noise: Mapping[str, float] | None = None,
) -> list[float]:
    """Return, for each planted loss, the share of resampled comparisons that call it worse."""
    experiments = _experiments(runs)
    alarmed, rates = _worse(aspect), []
    for plant in plants:
        rng = np.random.default_rng(seed)
        drawn = [resample(experiments, rng) for _ in range(comparisons)]
        hits = [alarmed(compare([plant(r) for r in new], old, noise=noise)) for new, old in drawn]
        rates.append(float(np.mean(hits)))
    return rates


def _experiments(runs: Sequence[Sequence[Row]]) -> list[Experiments]:
    found: list[Experiments] = [
        {(key_of(row), row["seed"]): row for row in refused(rows) if row["status"] == "finished"}
        for rows in runs
    ]
    if len(found) < 2 or not found[0] or any(one.keys() != found[0].keys() for one in found):
        raise InputError("self-check: expected two runs or more with the same finished experiments")
    return found


def resample(runs: Sequence[Experiments], rng: np.random.Generator) -> tuple[list[Row], list[Row]]:
    """Return (candidate, baseline) of one A/A comparison."""
    draws: dict[object, list[int]] = {}
    candidate, baseline = [], []
    whole = bool(rng.integers(2))
    new, old = rng.choice(len(runs), 2, replace=False)
    for name, one in runs[0].items():
        if not whole:
            new, old = rng.choice(len(runs), 2, replace=False)
        cell = key_of(one)
        if cell not in draws:  # all seeds of a cell share the views
            held_out = [view for view in one["per_view"] if view["split"] == "test"]
            draws[cell] = rng.choice(len(held_out), len(held_out)).tolist() if held_out else []
        candidate.append(_drawn(runs[new][name], draws[cell]))
        baseline.append(_drawn(runs[old][name], draws[cell]))
    return candidate, baseline


def _drawn(row: Row, places: Sequence[int]) -> Row:
    held_out = sorted(
        (view for view in row["per_view"] if view["split"] == "test"),
        key=lambda view: str(view["view"]),
    )
    views = [held_out[p] | {"view": f"{i:03d} {held_out[p]['view']}"} for i, p in enumerate(places)]
    return row | {"per_view": views}


def _worse(aspect: str | None) -> Callable[[GateReport], bool]:
    def alarmed(report: GateReport) -> bool:
        return any(
            finding.verdict == Verdict.WORSE and aspect in (None, finding.aspect)
            for finding in report.findings
        )

    return alarmed
