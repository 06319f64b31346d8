"""What a reader should take home: one sentence for all, one per capture, and the evidence.

A method is compared with plain 3DGS on the same background, inside the object's mask, paired by
view and seed; a gain is called one only when the 95 % interval excludes zero. Where the rows have
3DGS with the rates and thresholds of ``ours+`` (``3dgs-tuned``), each claim is made against that
too. Size and time are ratios of means; differences below 1 % are called none.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, geometric_mean

from reports.rows import clock, columns, statistics
from reports.rows.columns import joined, signed
from reports.rows.doubts import in_doubt
from reports.rows.schema import (
    Cell,
    Row,
    background_name,
    capture_name,
    captures,
    cells,
    method_name,
    refused,
)
from reports.tables.notes import parts_known
from reports.tables.pairs import (
    BASE,
    CONTROL,
    KINDS,
    NO_VIEW,
    OTHER_SCORE,
    PREPOSITIONS,
    Comparison,
    compare,
    kind_of,
    quality_words,
    ratio,
    view_scores,
)

NEGLIGIBLE = 0.01  # ratios closer to one than this are called equal
IN_HEADLINE = 2  # methods; the others stand among the details
PREFERRED = ("nobg", "original")  # the headline is about the paper's proposal where it was run
WHERE = {"nobg": "without its background", "original": "with its background"}
OVER_ALL = {"nobg": "Without backgrounds", "original": "With backgrounds"}


@dataclass(frozen=True)
class Verdict:
    """``headline`` is the sentence; ``details`` are the numbers behind it and other conditions."""

    capture: str
    headline: str
    details: tuple[str, ...]


def overall(rows: Sequence[Row]) -> Verdict | None:
    """Return the verdict over all captures; None where fewer than two compare.

    Captures in doubt do not count.
    """
    rows = refused(rows)
    doubted = in_doubt(rows)
    rows = [row for row in rows if row["capture"] not in doubted]
    selected = cells(rows)
    timer = clock.clock_of(rows)
    by_method: dict[tuple[str, str, str], list[Comparison]] = {}
    for name in captures(rows):
        members = [cell for cell in selected if cell.key.capture == name]
        for background in PREFERRED:
            for base in (BASE, CONTROL):
                for one in compare(members, background, base, timer):
                    by_method.setdefault((background, one.method, base), []).append(one)
    second = parts_known([row for cell in selected for row in cell.finished])
    sentences = [
        _over_all(background, method, compared, second)
        for background in PREFERRED
        for (place, method, base), compared in sorted(by_method.items(), key=_is_control)
        if place == background and len(compared) > 1
    ]
    if not sentences:
        return None
    return Verdict("", sentences[0], tuple(sentences[1:]))


def _is_control(entry: tuple[tuple[str, str, str], list[Comparison]]) -> bool:
    """Put claims on the control itself behind those on the methods that it controls for."""
    return entry[0][1] == CONTROL


def _over_all(
    background: str, method: str, comparisons: Sequence[Comparison], over_captures: bool
) -> str:
    """Count captures by what a method does there, with the means of its differences.

    Scores inside the mask and over the full frame do not mix: what most captures have counts.
    ``over_captures``: the mean has an interval, whose samples are the captures.
    """
    metrics = Counter(c.metric for c in comparisons if c.quality is not None)
    metric = metrics.most_common(1)[0][0] if metrics else comparisons[0].metric
    measured = [c.quality for c in comparisons if c.quality is not None and c.metric == metric]
    found = Counter(kind_of(quality) for quality in measured)
    counts = _counts(
        comparisons[0].base,
        {
            **{kind: found[kind] for kind in KINDS},
            OTHER_SCORE: metrics.total() - len(measured),
            NO_VIEW: len(comparisons) - metrics.total(),
        },
    )
    means = [quality.mean for quality in measured]
    where = "inside the mask" if metric == "mask_psnr" else "over the full frame"
    interval = statistics.sample(means) if over_captures and len(means) > 1 else None
    spread = "" if interval is None else f" ± {interval.half:.2f}"
    parts = [f"{signed(fmean(means))}{spread} dB {where}"] if means else []
    for name, ratios in (
        ("size", [c.size for c in comparisons]),
        (clock.WORDS[comparisons[0].clock], [c.time for c in comparisons]),
    ):
        positive = [ratio for ratio in ratios if ratio]
        parts += [f"{name} × {geometric_mean(positive):.2f}"] if positive else []
    text = f"{OVER_ALL[background]}, {method_name(method)} {joined(counts)}"
    return f"{text}; on average {', '.join(parts)}." if parts else f"{text}."


def _counts(base: str, kinds: Mapping[str, int]) -> list[str]:
    """Say on how many captures something happened; the first part names what is compared with."""
    present = [(verb, count) for verb, count in kinds.items() if count]
    verb, count = present[0]
    total = sum(kinds.values())
    everywhere = "both captures" if total == 2 else f"all {total} captures"
    where = everywhere if len(present) == 1 else f"{count} of {total} captures"
    rest = [f"{verb} on {count}" for verb, count in present[1:]]
    return [f"{verb} {PREPOSITIONS[verb]} {method_name(base)} on {where}", *rest]


def verdicts(rows: Sequence[Row]) -> list[Verdict]:
    """Return one verdict per capture, in the order of the tables."""
    rows = refused(rows)
    selected, doubted, timer = cells(rows), in_doubt(rows), clock.clock_of(rows)
    by_capture = [
        _of_capture(name, [c for c in selected if c.key.capture == name], timer)
        for name in captures(rows)
    ]
    return [
        Verdict(one.capture, withheld(one.capture, doubted[one.capture]), ())
        if one.capture in doubted
        else one
        for one in by_capture
    ]


def withheld(name: str, subjects: Sequence[str]) -> str:
    """Return what stands in a verdict's place where a capture is in doubt."""
    return (
        f"{capture_name(name)}: no verdict. Its {joined(subjects)} are in doubt: see the warnings."
    )


def _of_capture(name: str, selected: Sequence[Cell], timer: str) -> Verdict:
    label = capture_name(name)
    failed = [cell for cell in selected if not cell.finished]
    comparisons, controls = (
        [c for background in PREFERRED for c in compare(selected, background, base, timer)]
        for base in (BASE, CONTROL)
    )
    details = [_detail(c) for c in (*comparisons, *controls)]
    saved = _background_saving(selected, timer)
    details += [saved] if saved else []
    if failed:
        names = ", ".join(cell.key.condition for cell in failed)
        details.append(f"Failed: {names}; the notes under the table say why.")
    if not comparisons:
        what = "no condition finished" if len(failed) == len(selected) else "nothing to compare"
        return Verdict(name, f"{label}: {what}.", tuple(details))
    background = comparisons[0].background
    headlines = [
        one for one in comparisons if one.background == background and one.method != CONTROL
    ]
    headlines = headlines[:IN_HEADLINE] or comparisons[:1]
    against = {one.method: one for one in controls if one.background == background}
    words = "; ".join(_headline(one, against.get(one.method)) for one in headlines)
    return Verdict(name, f"{label}: {WHERE[background]}, {words}.", tuple(details))


def _headline(comparison: Comparison, control: Comparison | None) -> str:
    words = f"{method_name(comparison.method)} {quality_words(comparison)} {method_name(BASE)}"
    words += _cost_words(comparison)
    if control is None:
        return words
    return f"{words}, and {quality_words(control)} {method_name(CONTROL)}"


def _cost_words(comparison: Comparison) -> str:
    parts, spent = [], "CPU" if comparison.clock == clock.CPU else "training"
    for times, saved, cost in (
        (comparison.size, "{article} {} smaller file", "{article} {} larger file"),
        (comparison.time, f"{{}} less {spent} time", f"{{}} more {spent} time"),
    ):
        if times is not None and abs(times - 1) >= NEGLIGIBLE:
            percent = f"{abs(times - 1) * 100:.0f}"
            words = saved if times < 1 else cost
            parts.append(words.format(f"{percent} %", article=_article(percent)))
    if not parts:
        same = [w for w, r in (("size", comparison.size), ("time", comparison.time)) if r]
        return f" at the same {' and '.join(same)}" if same else ""
    return ", with " + " and ".join(parts)


def _article(number: str) -> str:
    """Return the article of a number as it is spoken: an eight, an eleven, an eighteen."""
    return "an" if number.startswith("8") or number in ("11", "18") else "a"


def _detail(comparison: Comparison) -> str:
    pair = f"{method_name(comparison.method)} − {method_name(comparison.base)}"
    head = f"{background_name(comparison.background)}: {pair}"
    quality = comparison.quality
    metric = "PSNR in mask" if comparison.metric == "mask_psnr" else "PSNR"
    if quality is None:
        text = "no shared view"
    elif quality.samples < 2:
        text = f"{metric} {signed(quality.mean)} dB (one view: no interval)"
    else:
        text = (
            f"{metric} {signed(quality.mean)} dB (95 % interval {signed(quality.low)} to "
            f"{signed(quality.high)}, {quality.samples} paired views)"
        )
    if comparison.median is not None:
        text += f", median {signed(comparison.median)} dB, as some views are outliers"
    ratios = ((comparison.size, "size"), (comparison.time, clock.WORDS[comparison.clock]))
    small = (
        [] if comparison.details is None else [f"small parts {signed(comparison.details.mean)} dB"]
    )
    parts = small + [f"{name} × {ratio:.2f}" for ratio, name in ratios if ratio is not None]
    return f"{head}: {'; '.join([text, *parts])}."


def _background_saving(selected: Sequence[Cell], timer: str) -> str:
    """Say what removing the background changes for plain 3DGS."""
    base = {c.key.background: c for c in selected if c.key.method == BASE and c.finished}
    if base.keys() < {"original", "nobg"}:
        return ""
    size = ratio(base["nobg"], base["original"], "size_mb")
    time = ratio(base["nobg"], base["original"], timer)
    quality = statistics.paired(
        view_scores(base["nobg"], "mask_psnr"), view_scores(base["original"], "mask_psnr")
    )
    parts = [f"PSNR in mask {signed(quality.mean)} dB"] if quality else []
    for metric, part in (("core_psnr", "in its core"), ("rim_psnr", "on its rim")):
        there = statistics.paired(
            view_scores(base["nobg"], metric), view_scores(base["original"], metric)
        )
        parts += [f"{part} {signed(there.mean)} dB"] if there else []
    parts += [f"size × {size:.2f}"] if size else []
    parts += [f"{clock.WORDS[timer]} × {time:.2f}"] if time else []
    return f"Removing the background, with 3DGS: {'; '.join(parts)}."


def summary_line(rows: Sequence[Row], planned: int | None = None) -> str:
    """Say how many experiments finished, of the rows or of those planned, and how long it took."""
    rows = refused(rows)
    finished = [row for row in rows if row["status"] == "finished"]
    total = sum(float(row["metrics"]["time"]) for row in finished)
    return (
        f"{len(finished)} of {planned or len(rows)} experiments finished; "
        f"{columns.duration(total)} of training in all."
    )


def facts(rows: Sequence[Row]) -> dict[str, str]:
    """Say under what settings and on what machines the rows came about; label and value."""
    rows = refused(rows)
    origins = [row.get("provenance") or {} for row in rows if row["status"] == "finished"]
    entries = {
        "Iterations": {f"{int(row['iterations']):,}" for row in rows},
        "Longest side": {f"{row['resolution']} px" for row in rows},
        "Seeds": {str(row["seed"]) for row in rows},
        "CPU": {str(origin["cpu"]) for origin in origins if origin.get("cpu")},
        "Threads per training": {str(o["threads"]) for o in origins if o.get("threads")},
    }
    return {label: ", ".join(sorted(values)) for label, values in entries.items() if values}
