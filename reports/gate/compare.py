"""The gate's decision: candidate rows and baseline rows in, verdicts out. Nothing is printed here.

Each number of each cell gets one of eight verdicts. For a change with interval [low, high]
(positive is better) and a margin m: ``better`` when low > m, ``worse`` when high < -m, ``same``
when the whole interval lies within ±m, else ``inconclusive``: not enough was measured to say.
``not comparable``: a number is missing or not finite, or the rows were made from other inputs,
another configuration or protocol, or scored against another truth. ``newly failing``, ``still
failing`` and ``fixed`` are about experiments that failed, now, both times or before.

Every number is judged in each cell, and again over all cells: a loss that is everywhere but small
shows only there. Confidences are set in ``tolerances.py`` so that unchanged code raises an alarm in
less than 1 % of gate runs.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import fmean

from reports.gate import speed
from reports.gate.findings import ALL_CELLS, Exit, Finding, GateReport, Verdict
from reports.gate.intervals import interval_of, interval_of_all, spread_among
from reports.gate.numbers import Judged, collect, worst_view
from reports.gate.tolerances import POOL_LEAST, TOLERANCES, Doubt, Tolerance, confidence
from reports.rows import comparable
from reports.rows.schema import Cell, CellKey, Row, cells, order, refused
from reports.rows.statistics import Interval

SCORES = {t.metric for t in TOLERANCES if t.kind == "difference"}
CONCLUSIVE = {Verdict.BETTER, Verdict.SAME}  # and worse, which has a code of its own


def compare(
    candidate: Sequence[Row],
    baseline: Sequence[Row],
    *,
    noise: Mapping[str, float] | None = None,
    doubt: Doubt = Doubt.MARGIN,
) -> GateReport:
    """Judge ``candidate`` against ``baseline``.

    ``noise`` is a baseline's, by metric, measured between machines; it counts for cells that were
    made on unlike machines, and for no others. ``doubt`` says which inconclusive numbers make the
    outcome one that cannot be judged. Speeds that were measured on another machine are not
    compared: one excused finding over all cells says so for each.
    """
    between = noise or {}
    table = [replace(t, between=between.get(t.metric)) for t in TOLERANCES]
    findings, judged = collected(candidate, baseline, table)
    findings += _judge(judged, table)
    ranked = tuple(sorted(findings, key=_rank))
    return GateReport(ranked, exit_code(ranked, doubt))


def collected(
    candidate: Sequence[Row], baseline: Sequence[Row], table: Sequence[Tolerance] = TOLERANCES
) -> tuple[list[Finding], list[Judged]]:
    """Return what can be said without statistics, and the numbers that need them."""
    ours = {cell.key: cell for cell in cells(refused(candidate))}
    theirs = {cell.key: cell for cell in cells(refused(baseline))}
    findings: list[Finding] = []
    judged: list[Judged] = []
    for key in sorted(ours.keys() | theirs.keys(), key=order):
        twice = _twice({"candidate": ours.get(key), "baseline": theirs.get(key)})
        if twice:
            findings.append(Finding(str(key), "run", "rows", Verdict.NOT_COMPARABLE, twice))
            continue
        status = _status(key, ours.get(key), theirs.get(key))
        if status is not None:
            findings.append(status)
        if key in ours and key in theirs:
            more, numbers = _of_cell(ours[key], theirs[key], table)
            findings += more
            judged += numbers
    return list(dict.fromkeys(findings)), judged


def _of_cell(
    ours: Cell, theirs: Cell, table: Sequence[Tolerance]
) -> tuple[list[Finding], list[Judged]]:
    """Collect one cell's numbers; a speed of another machine gets a finding over all cells."""
    findings: list[Finding] = []
    judged: list[Judged] = []
    name = str(ours.key)
    pairs, blocked = _paired_rows(ours, theirs)
    views = {text for pair in pairs for text in comparable.other_views(*pair)}
    if blocked:
        findings.append(Finding(name, "run", "rows", Verdict.NOT_COMPARABLE, "; ".join(blocked)))
    if set(blocked) - views:
        return findings, []
    unlike = list(dict.fromkeys(text for pair in pairs for text in comparable.other_truth(*pair)))
    if unlike and not blocked:
        findings.append(Finding(name, "run", "truth", Verdict.NOT_COMPARABLE, "; ".join(unlike)))
    if unlike or blocked:  # the quality of masks and the number of poses can still be judged
        table = [tolerance for tolerance in table if tolerance.upstream]
    for tolerance in table if pairs else ():
        moved = _moved(tolerance, pairs)
        if moved:
            names = (ALL_CELLS, tolerance.aspect, tolerance.metric)
            findings.append(Finding(*names, Verdict.NOT_COMPARABLE, moved, excused=True))
            continue
        number, problem = collect(ours.key, tolerance, pairs)
        if number is not None:
            judged.append(number)
        elif problem:
            names = (name, tolerance.aspect, tolerance.metric)
            findings.append(Finding(*names, Verdict.NOT_COMPARABLE, problem))
    return findings, judged


def _moved(tolerance: Tolerance, pairs: Sequence[tuple[Row, Row]]) -> str:
    """Say why speeds of these rows do not compare, empty where they do."""
    if tolerance.kind != "speed":
        return ""
    return next(filter(None, (speed.other_machine(*pair, tolerance.metric) for pair in pairs)), "")


def exit_code(findings: Sequence[Finding], doubt: Doubt = Doubt.MARGIN) -> int:
    """1 for a regression, else 3 for failed runs, else 2 for what cannot be judged, else 0."""
    verdicts = {finding.verdict for finding in findings}
    if Verdict.WORSE in verdicts:
        return Exit.REGRESSION
    if Verdict.NEWLY_FAILING in verdicts:
        return Exit.FAILED_RUNS
    unlike = [f for f in findings if f.verdict == Verdict.NOT_COMPARABLE]
    if any(doubt == Doubt.ALL or not finding.excused for finding in unlike):
        return Exit.CANNOT_JUDGE
    if not any(f.metric in SCORES and f.verdict in CONCLUSIVE for f in findings):
        return Exit.CANNOT_JUDGE  # nothing was judged
    doubtful = [f for f in findings if f.verdict == Verdict.INCONCLUSIVE]
    if doubt == Doubt.ALL and doubtful:
        return Exit.CANNOT_JUDGE
    if doubt == Doubt.MARGIN and any(_alarming(finding) for finding in doubtful):
        return Exit.CANNOT_JUDGE
    return Exit.PASS


def _alarming(finding: Finding) -> bool:
    """Doubtful, and the estimate is a loss beyond the margin.

    Speed in a single cell is one noisy measurement; it alarms only over all cells.
    """
    if finding.aspect == "cost" and finding.cell != ALL_CELLS:
        return False
    return finding.change is not None and finding.change.mean < -finding.margin


def _twice(sides: Mapping[str, Cell | None]) -> str:
    """Say which experiments of a cell have more than one row, of which none is the right one."""
    return "; ".join(
        f"seed {seed} appears {times} times in the {side}"
        for side, cell in sides.items()
        if cell is not None
        for seed, times in sorted(Counter(int(row["seed"]) for row in cell.rows).items())
        if times > 1
    )


def _status(key: CellKey, ours: Cell | None, theirs: Cell | None) -> Finding | None:
    """Say what became of a cell's experiments."""
    name = str(key)
    if ours is None:
        reason = "the cell is missing from the candidate"
        return Finding(name, "run", "status", Verdict.NEWLY_FAILING, reason)
    if theirs is None:
        reason = "the baseline has no such cell; make a new one"
        return Finding(name, "run", "status", Verdict.NOT_COMPARABLE, reason)
    before, after = ({int(row["seed"]) for row in cell.finished} for cell in (theirs, ours))
    reasons = {int(row["seed"]): str(row.get("reason")) for row in ours.failed}
    failed = {int(row["seed"]) for row in theirs.failed}
    for verdict, seeds, where in (
        (Verdict.NEWLY_FAILING, before - after, ""),
        (Verdict.NOT_COMPARABLE, reasons.keys() - failed, " (the baseline has no such seed)"),
        (Verdict.STILL_FAILING, reasons.keys() & failed, ""),
    ):
        if seeds:
            why = (f"seed {seed}: {reasons.get(seed, 'no row')}{where}" for seed in sorted(seeds))
            return Finding(name, "run", "status", verdict, "; ".join(why))
    if after & failed:
        return Finding(name, "run", "status", Verdict.FIXED, "failed in the baseline")
    return Finding(name, "run", "status", Verdict.SAME)


def _paired_rows(ours: Cell, theirs: Cell) -> tuple[list[tuple[Row, Row]], list[str]]:
    """Pair finished rows by seed: (after, before); and why they must not be compared.

    Finished rows are valid: :func:`refused` has seen to that.
    """
    before = {int(row["seed"]): row for row in theirs.finished}
    pairs = [(row, before[int(row["seed"])]) for row in ours.finished if int(row["seed"]) in before]
    blocked = [text for pair in pairs for text in comparable.reasons_of_valid(*pair)]
    if not pairs and before and ours.finished:
        blocked = ["no seed in common"]
    return pairs, list(dict.fromkeys(blocked))


def _judge(judged: Sequence[Judged], table: Sequence[Tolerance]) -> list[Finding]:
    """Set intervals and verdicts, in each cell and over all cells."""
    findings: list[Finding] = []
    by_aspect: dict[str, int] = {}
    for number in judged:
        aspect = number.tolerance.aspect
        exact = number.tolerance.kind == "exact" and number.noise == 0
        by_aspect[aspect] = by_aspect.get(aspect, 0) + (not exact)
    for tolerance in table:
        mine = [n for n in judged if n.tolerance.metric == tolerance.metric]
        among = spread_among(mine)
        level = confidence(tolerance.aspect, "cell", by_aspect.get(tolerance.aspect, 1))
        for number in mine:
            interval = interval_of(number, level, among, len(mine))
            values = (number.before, number.after)
            finding = _finding(str(number.key), tolerance, values, interval)
            findings.append(replace(finding, worst_view=worst_view(number)))
        if tolerance.kind == "exact" or len(mine) < POOL_LEAST:
            continue
        kinds = {n.tolerance.metric for n in judged if n.tolerance.aspect == tolerance.aspect}
        level = confidence(tolerance.aspect, "all", len(kinds))
        interval = interval_of_all(mine, level)
        before, after = fmean(n.before for n in mine), fmean(n.after for n in mine)
        findings.append(_finding(ALL_CELLS, tolerance, (before, after), interval))
    return findings


def _finding(
    cell: str, tolerance: Tolerance, values: tuple[float, float], change: Interval
) -> Finding:
    verdict = verdict_of(change, tolerance.margin)
    return Finding(
        cell,
        tolerance.aspect,
        tolerance.metric,
        verdict,
        before=values[0],
        after=values[1],
        change=change,
        margin=tolerance.margin,
    )


def verdict_of(change: Interval, margin: float) -> Verdict:
    """Apply the rule of the module's docstring."""
    if change.low > margin:
        return Verdict.BETTER
    if change.high < -margin:
        return Verdict.WORSE
    if change.low >= -margin and change.high <= margin:
        return Verdict.SAME
    return Verdict.INCONCLUSIVE


_RANKS = {
    Verdict.WORSE: 0,
    Verdict.NEWLY_FAILING: 1,
    Verdict.NOT_COMPARABLE: 2,
    Verdict.INCONCLUSIVE: 3,
    Verdict.STILL_FAILING: 4,
    Verdict.FIXED: 5,
    Verdict.BETTER: 6,
    Verdict.SAME: 7,
}


def _rank(finding: Finding) -> tuple[int, float, str, str]:
    return _RANKS[finding.verdict], finding.severity, finding.cell, finding.metric
