"""How often the gate errs: false alarms of unchanged code, and planted losses that it misses.

Between runs of the same code nothing changed, so whatever is called worse is a false alarm. Runs
are compared in two ways. **Independent**: each run is used once, the first against the second, the
third against the fourth; N runs give N / 2 comparisons, and only these bound a rate.
**Resampled**: which run is called candidate and which baseline is drawn for a comparison as a whole
in one half of them, so that what all cells of a run share stays shared, and for each experiment
anew in the other half; held-out views are drawn with replacement. However many of these are drawn,
they hold no more than the runs do. The same comparisons with a loss planted into the candidate,
into other views and captures each time, show what the gate catches.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from mattgs_ops.errors import InputError
from reports.gate.compare import compare
from reports.gate.findings import Exit, GateReport, Verdict
from reports.gate.planted import EVERYWHERE, GROWTH, SLOWDOWN, grow, lose_everywhere, lose_speed
from reports.rows.schema import Row, key_of, refused

LEAST = 200  # resampled comparisons
FALSE_MOST, CAUGHT_LEAST = 0.01, 0.95
CONFIDENCE = 0.95  # one-sided confidence of bounds
Experiments = dict[object, Row]
Comparison = tuple[list[Row], list[Row]]  # candidate, baseline
Plant = Callable[[list[Row], int], list[Row]]
# What is planted, the aspect that must be called worse, and how a draw of it changes rows
PLANTED: dict[str, tuple[str, Plant]] = {
    f"{EVERYWHERE} dB": ("quality", lambda rows, draw: lose_everywhere(rows, draw=draw)),
    f"{SLOWDOWN:.0%} slower": ("cost", lambda rows, _: [lose_speed(row) for row in rows]),
    f"{GROWTH:.0%} larger": ("size", lambda rows, _: [grow(row) for row in rows]),
}


@dataclass(frozen=True)
class Rate:
    """How often something happened in independent trials."""

    hits: int
    trials: int

    @property
    def share(self) -> float:
        """Hits over trials, 0 of none."""
        return self.hits / self.trials if self.trials else 0.0

    @property
    def most(self) -> float:
        """Upper bound of the rate (Clopper & Pearson 1934); about 3 / trials without a hit."""
        if self.hits >= self.trials:
            return 1.0
        return float(betaincinv(self.hits + 1, self.trials - self.hits, CONFIDENCE))

    @property
    def least(self) -> float:
        """Lower bound of the rate, likewise."""
        if self.hits == 0:
            return 0.0
        return float(betaincinv(self.hits, self.trials - self.hits + 1, 1 - CONFIDENCE))


@dataclass(frozen=True)
class Outcome:
    """Rates over comparisons: without a change, and by what was planted into the candidate.

    ``alarms`` counts, by metric, the comparisons in which it was falsely called worse.
    """

    false_alarms: Rate
    doubts: Rate
    caught: Mapping[str, Rate]
    alarms: Mapping[str, int]


@dataclass(frozen=True)
class SelfCheck:
    """What ``runs`` runs of the same code say of the gate."""

    runs: int
    independent: Outcome
    resampled: Outcome

    @property
    def trusted(self) -> bool:
        """Whether the gate meets what is required of it, as far as these runs can say.

        Under 1 % false and 95 % caught of what was resampled, and no more or less of what is
        independent than chance can make of such rates.
        """
        alone, drawn = self.independent, self.resampled
        sure = alone.false_alarms.least < FALSE_MOST and all(
            rate.most >= CAUGHT_LEAST for rate in alone.caught.values()
        )
        caught = min(rate.share for rate in drawn.caught.values())
        return sure and drawn.false_alarms.share < FALSE_MOST and caught >= CAUGHT_LEAST


def markdown(check: SelfCheck) -> str:
    """Return the outcome as a Markdown table with two sentences on top."""
    verdict = "may" if check.trusted else "may not"
    alarms = check.independent.false_alarms
    first = (
        f"Self-check: the gate {verdict} be trusted on such runs "
        f"(required: under {FALSE_MOST:.0%} false, at least {CAUGHT_LEAST:.0%} caught)."
    )
    second = (
        f"{check.runs} runs are {alarms.trials} independent comparisons: {alarms.hits} false "
        f"alarms bound their rate at {alarms.most:.1%} ({CONFIDENCE:.0%} confidence)."
    )
    caught = " | ".join(f"{name} caught" for name in PLANTED)
    head = f"| comparisons | number | false alarms | cannot judge | {caught} |"
    lines = [first, second, "", head, "| --- |" + " --: |" * (3 + len(PLANTED))]
    for name, one in (("independent", check.independent), ("resampled", check.resampled)):
        rates = [one.false_alarms, one.doubts, *one.caught.values()]
        shares = " | ".join(f"{rate.share:.1%}" for rate in rates)
        lines.append(f"| {name} | {one.false_alarms.trials} | {shares} |")
    return "\n".join(lines)


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
    return SelfCheck(
        len(runs), rates_of(independent(runs), noise=noise), rates_of(drawn, noise=noise)
    )


def independent(runs: Sequence[Sequence[Row]]) -> list[Comparison]:
    """Return comparisons that share no run."""
    return [(list(new), list(old)) for new, old in zip(runs[1::2], runs[::2], strict=False)]


def rates_of(
    comparisons: Sequence[Comparison], *, noise: Mapping[str, float] | None = None
) -> Outcome:
    """Judge comparisons of unchanged code as they are, and once with each loss planted."""
    reports = [compare(new, old, noise=noise) for new, old in comparisons]
    count = len(reports)
    metrics = Counter(metric for report in reports for metric in worse(report))
    alarms = sum(bool(worse(report)) for report in reports)
    doubts = sum(report.exit_code == Exit.CANNOT_JUDGE for report in reports)
    caught = {
        name: Rate(sum(_caught(comparisons, aspect, plant, noise)), count)
        for name, (aspect, plant) in PLANTED.items()
    }
    return Outcome(Rate(alarms, count), Rate(doubts, count), caught, dict(metrics))


def _caught(
    comparisons: Sequence[Comparison],
    aspect: str,
    plant: Plant,
    noise: Mapping[str, float] | None,
) -> list[bool]:
    """Say of each comparison whether a loss planted into its candidate is called worse."""
    return [
        bool(worse(compare(plant(new, draw), old, noise=noise), aspect))
        for draw, (new, old) in enumerate(comparisons)
    ]


def worse(report: GateReport, aspect: str | None = None) -> set[str]:
    """Return the metrics that are called worse, of all aspects or of one."""
    return {
        finding.metric
        for finding in report.findings
        if finding.verdict == Verdict.WORSE and aspect in (None, finding.aspect)
    }


def _experiments(runs: Sequence[Sequence[Row]]) -> list[Experiments]:
    experiments: list[Experiments] = [
        {(key_of(row), row["seed"]): row for row in refused(rows) if row["status"] == "finished"}
        for rows in runs
    ]
    if (
        len(experiments) < 2
        or not experiments[0]
        or any(one.keys() != experiments[0].keys() for one in experiments)
    ):
        raise InputError("self-check: expected two runs or more with the same finished experiments")
    return experiments


def resample(runs: Sequence[Experiments], rng: np.random.Generator) -> tuple[list[Row], list[Row]]:
    """Return (candidate, baseline) of one A/A comparison."""
    draws: dict[object, list[int]] = {}
    candidate, baseline = [], []
    together = bool(rng.integers(2))
    new, old = rng.choice(len(runs), 2, replace=False)
    for name, one in runs[0].items():
        if not together:
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
