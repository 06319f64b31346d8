"""A gate report as text, Markdown, JUnit XML and JSON. Decides nothing.

The JSON follows ``schema.json``; its changes are signed so that positive is better. People read the
change from before to after, beside both numbers, and the verdict says which way is better.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from mattgs_ops.whole_file import write_text_whole
from reports.gate import tolerances
from reports.gate.findings import ALL_CELLS, Exit, Finding, GateReport, Verdict
from reports.markdown import table_cell
from reports.rows.statistics import Interval

SCHEMA = 4
IN_WORDS = {
    "psnr": "PSNR",
    "mask_psnr": "PSNR in mask",
    "size_mb": "size",
    "time": "time",
    "fps": "FPS",
}
MEANING = {
    Exit.PASS: "pass",
    Exit.REGRESSION: "regression",
    Exit.CANNOT_JUDGE: "cannot judge",
    Exit.FAILED_RUNS: "failed runs",
}
FAILURES = {Verdict.WORSE, Verdict.NEWLY_FAILING}
SKIPPED = {Verdict.INCONCLUSIVE, Verdict.STILL_FAILING}  # in JUnit, with what is excused
MEASURED = {"time": "time ÷ workload", "fps": "FPS × workload"}  # what speeds are compared as
FALLS = {t.metric for t in tolerances.TOLERANCES if t.direction < 0}  # that are better for it
LARGE = 1000  # numbers that are printed whole
RATIOS = {t.metric for t in tolerances.TOLERANCES if t.kind in ("ratio", "speed")}
MOST_LINES = 40


def write(
    report: GateReport, folder: Path, pictures: Sequence[tuple[str, str]] = ()
) -> dict[str, Path]:
    """Write ``gate.md``, ``gate.xml`` (JUnit) and ``gate.json``; returns the paths by suffix."""
    texts = {"md": markdown(report, pictures), "xml": junit(report), "json": to_json(report)}
    paths = {suffix: folder / f"gate.{suffix}" for suffix in texts}
    for suffix, path in paths.items():
        write_text_whole(path, texts[suffix])
    return paths


def terminal(report: GateReport) -> str:
    """Verdict first, then what is not "same", the worst first; at most 100 columns wide."""
    lines = [f"Gate: {MEANING[report.exit_code]}. {counts(report)}", *sensitivity_lines(report), ""]
    findings = worth_reading(report)
    if not findings:
        return "\n".join(lines)
    rows = [["Verdict", "Cell", "Metric", "Before", "After", "Change", "Interval"]]
    rows += [_cells(finding) for finding in findings[:MOST_LINES]]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    if len(findings) > MOST_LINES:
        lines.append(f"… and {len(findings) - MOST_LINES} more")
    explained = [f for f in findings if f.reason]
    lines += (
        ["", *(f"{f.cell} {f.metric}: {f.reason}" for f in explained[:MOST_LINES])]
        if explained
        else []
    )
    return "\n".join(lines) + "\n"


def markdown(report: GateReport, pictures: Sequence[tuple[str, str]] = ()) -> str:
    """For a CI job's summary; ``pictures`` are (caption, link) of the view that changed most."""
    lines = [f"## Gate: {MEANING[report.exit_code]}", "", counts(report), ""]
    lines += [text for line in sensitivity_lines(report) for text in (line, "")]
    findings = worth_reading(report)
    if findings:
        lines += [
            "| Verdict | Cell | Metric | Before | After | Change | Interval | Why |",
            "| --- | --- | --- | --: | --: | --: | --- | --- |",
        ]
        for finding in findings:
            cells = [*_cells(finding), finding.reason]
            if finding.verdict in FAILURES:
                cells[0] = f"**{cells[0]}**"
            lines.append("| " + " | ".join(map(table_cell, cells)) + " |")
        lines.append("")
    for caption, link in pictures:
        lines += [f"![{caption}]({link})", "", f"*{caption}*", ""]
    lines.append(
        "Quality is paired by view and seed, speed is divided by the calibration workload of its "
        f"own process; intervals keep false alarms below {tolerances.ALARM:.0%} of gate runs."
    )
    return "\n".join(lines) + "\n"


def junit(report: GateReport) -> str:
    """One test suite per cell, one test case per metric; what cannot be judged is an error."""
    root = ElementTree.Element("testsuites", name="mattgs gate")
    suites: dict[str, list[Finding]] = {}
    for finding in report.findings:
        suites.setdefault(finding.cell, []).append(finding)
    for cell in sorted(suites, key=lambda name: (name != ALL_CELLS, name)):
        mine = sorted(suites[cell], key=lambda finding: finding.metric)
        failures = sum(finding.verdict in FAILURES for finding in mine)
        errors = sum(_is_error(finding) for finding in mine)
        skipped = sum(f.excused or f.verdict in SKIPPED for f in mine)
        attributes = {
            "name": cell,
            "tests": str(len(mine)),
            "failures": str(failures),
            "errors": str(errors),
            "skipped": str(skipped),
        }
        suite = ElementTree.SubElement(root, "testsuite", attributes)
        for finding in mine:
            case = ElementTree.SubElement(suite, "testcase", classname=cell, name=finding.metric)
            _junit_outcome(case, finding)
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{body}\n'


def _is_error(finding: Finding) -> bool:
    return finding.verdict == Verdict.NOT_COMPARABLE and not finding.excused


def _junit_outcome(case: ElementTree.Element, finding: Finding) -> None:
    message = f"{finding.verdict}: {sentence(finding)}"
    if finding.verdict in FAILURES:
        ElementTree.SubElement(case, "failure", message=message, type=str(finding.verdict))
    elif _is_error(finding):
        ElementTree.SubElement(case, "error", message=message, type=str(finding.verdict))
    elif finding.excused or finding.verdict in SKIPPED:
        ElementTree.SubElement(case, "skipped", message=message)
    else:
        ElementTree.SubElement(case, "system-out").text = message


def to_json(report: GateReport) -> str:
    """Everything, for machines; see ``gate_schema.json``."""
    document = {
        "schema": SCHEMA,
        "exit_code": report.exit_code,
        "outcome": MEANING[report.exit_code],
        "counts": {str(verdict): report.count(verdict) for verdict in Verdict},
        "findings": [_document(finding) for finding in report.findings],
        "smallest_named": report.smallest_named(),
        "planted": None if report.planted is None else asdict(report.planted),
    }
    return json.dumps(document, indent=1, sort_keys=True, allow_nan=False) + "\n"


def _document(finding: Finding) -> dict[str, Any]:
    change = finding.change
    return {
        "cell": finding.cell,
        "aspect": finding.aspect,
        "metric": finding.metric,
        "verdict": str(finding.verdict),
        "reason": finding.reason,
        "before": finding.before,
        "after": finding.after,
        "change": None if change is None else change.mean,
        "interval": None if change is None else [_finite(change.low), _finite(change.high)],
        "relative": finding.metric in RATIOS,
        "margin": finding.margin,
        "worst_view": finding.worst_view,
        "excused": finding.excused,
    }


def _finite(value: float) -> float | None:
    """JSON knows no infinity: an open end is null."""
    return value if abs(value) != float("inf") else None


def worth_reading(report: GateReport) -> list[Finding]:
    """Return what a reader should see.

    Left out is what is the same, and single measurements of speed that are too noisy to say
    anything: speed over all cells sums them up.
    """
    return [
        finding
        for finding in report.findings
        if finding.verdict != Verdict.SAME
        and not (
            finding.verdict == Verdict.INCONCLUSIVE
            and finding.aspect == "cost"
            and finding.cell != ALL_CELLS
        )
    ]


def counts(report: GateReport) -> str:
    """How many findings have each verdict, in words."""
    numbers = [(report.count(verdict), str(verdict)) for verdict in Verdict]
    return ", ".join(f"{number} {name}" for number, name in numbers if number) + "."


def sensitivity_lines(report: GateReport) -> list[str]:
    """Say how small a loss this gate would have named, in lines."""
    smallest = report.smallest_named()
    parts = []
    for metric, called in IN_WORDS.items():
        if metric in smallest:
            unit = f"{smallest[metric]:.1%}" if metric in RATIOS else f"{smallest[metric]:.2f} dB"
            parts.append(f"{called} {unit}")
    lines = [f"A loss in all cells would be named from: {', '.join(parts)}."] if parts else []
    return lines + ([str(report.planted)] if report.planted is not None else [])


def sentence(finding: Finding) -> str:
    """One finding in words."""
    if finding.change is None:
        return finding.reason or "no difference"
    _, _, metric, before, after, change, interval = _cells(finding)
    where = f", most in view {finding.worst_view}" if finding.worst_view else ""
    return f"{metric} {before} → {after}, change {change} ({interval}){where}"


def _cells(finding: Finding) -> list[str]:
    change = None if finding.change is None else plain_change(finding.metric, finding.change)
    percent = finding.metric in RATIOS
    measured = finding.before is not None
    return [
        str(finding.verdict),
        finding.cell,
        MEASURED.get(finding.metric, finding.metric) if measured else finding.metric,
        _number(finding.before),
        _number(finding.after),
        "" if change is None else _signed(change.mean, percent=percent),
        ""
        if change is None
        else f"{_signed(change.low, percent=percent)} … {_signed(change.high, percent=percent)}",
    ]


def plain_change(metric: str, change: Interval) -> Interval:
    """Return the change from before to after, of one that is signed so that positive is better.

    Shares of ratios that are better when they fall are before/after − 1, and become after/before −
    1.
    """
    if metric not in FALLS:
        return change
    turned = _inverse if metric in RATIOS else float.__neg__
    return replace(
        change, mean=turned(change.mean), low=turned(change.high), high=turned(change.low)
    )


def _inverse(share: float) -> float:
    """Return b/a − 1 for a/b − 1; infinite where a is nothing."""
    return 1 / (1 + share) - 1 if share > -1 else math.inf


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= LARGE else f"{value:.4g}"


def _signed(value: float, *, percent: bool) -> str:
    text = f"{value * 100:+.1f} %" if percent else f"{value:+.4g}"
    return text.replace("-", "−").replace("inf", "∞")
