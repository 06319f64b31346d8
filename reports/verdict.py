"""What a reader should take home: one sentence per capture, and its evidence.

A method is compared with plain 3DGS on the same background, inside the object's mask, paired by
view and seed; a gain is called one only when the 95 % interval excludes zero. Size and time are
ratios of means; differences below 1 % are called none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from reports import columns, statistics
from reports.pairs import ratio, view_scores
from reports.rows import (
    Cell,
    Row,
    background_name,
    capture_name,
    captures,
    cells,
    method_name,
    refused,
)
from reports.statistics import Interval

BASE = "3dgs"
NEGLIGIBLE = 0.01  # ratios closer to one than this are called equal
PREFERRED = ("nobg", "original")  # the headline is about the paper's proposal where it was run
WHERE = {"nobg": "without its background", "original": "with its background"}


@dataclass(frozen=True)
class Verdict:
    """``headline`` is the sentence; ``details`` are the numbers behind it and other conditions."""

    capture: str
    headline: str
    details: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """A method against 3DGS on one background; ``size`` and ``time`` are ratios."""

    background: str
    method: str
    metric: str
    quality: Interval | None
    size: float | None
    time: float | None


def verdicts(rows: Sequence[Row]) -> list[Verdict]:
    """Return one verdict per capture, in the order of the tables."""
    rows = refused(rows)
    mine = cells(rows)
    return [
        _of_capture(name, [c for c in mine if c.key.capture == name]) for name in captures(rows)
    ]


def _of_capture(name: str, mine: Sequence[Cell]) -> Verdict:
    label = capture_name(name)
    failed = [cell for cell in mine if not cell.finished]
    found = [c for background in PREFERRED for c in compare(mine, background)]
    details = [_detail(c) for c in found]
    saved = _background_saving(mine)
    details += [saved] if saved else []
    if failed:
        names = ", ".join(cell.key.condition for cell in failed)
        details.append(f"Failed: {names}; the notes under the table say why.")
    if not found:
        what = "no condition finished" if len(failed) == len(mine) else "nothing to compare"
        return Verdict(name, f"{label}: {what}.", tuple(details))
    first = found[0]
    sentence = (
        f"{label}: {WHERE[first.background]}, {method_name(first.method)} "
        f"{_quality_words(first)} {method_name(BASE)}{_cost_words(first)}."
    )
    return Verdict(name, sentence, tuple(details))


def compare(mine: Sequence[Cell], background: str) -> list[Comparison]:
    """Compare every method of one capture and background with 3DGS."""
    finished = [c for c in mine if c.key.background == background and c.finished]
    base = next((c for c in finished if c.key.method == BASE), None)
    if base is None:
        return []
    out = []
    for cell in finished:
        if cell is base:
            continue
        masked = view_scores(cell, "mask_psnr") and view_scores(base, "mask_psnr")
        metric = "mask_psnr" if masked else "psnr"
        interval = statistics.paired(view_scores(cell, metric), view_scores(base, metric))
        size, time = ratio(cell, base, "size_mb"), ratio(cell, base, "time")
        out.append(Comparison(background, cell.key.method, metric, interval, size, time))
    return out


def signed(decibels: float) -> str:
    """Two decimals with a sign, a true minus among them."""
    return f"{decibels:+.2f}".replace("-", "−")


def _quality_words(found: Comparison) -> str:
    where = "inside the mask" if found.metric == "mask_psnr" else "over the full frame"
    quality = found.quality
    if quality is None:
        return "has no view in common with"
    if not quality.excludes_zero():
        return f"does not measurably differ {where} ({signed(quality.mean)} dB) from"
    verb, preposition = ("gains", "over") if quality.mean > 0 else ("loses", "against")
    return f"{verb} {abs(quality.mean):.2f} dB {where} {preposition}"


def _cost_words(found: Comparison) -> str:
    parts = []
    for times, saved, cost in (
        (found.size, "a {} smaller file", "a {} larger file"),
        (found.time, "{} less training time", "{} more training time"),
    ):
        if times is not None and abs(times - 1) >= NEGLIGIBLE:
            parts.append((saved if times < 1 else cost).format(f"{abs(times - 1) * 100:.0f} %"))
    if not parts:
        return " at the same size and time"
    return ", with " + " and ".join(parts)


def _detail(found: Comparison) -> str:
    head = f"{background_name(found.background)}: {method_name(found.method)} − {method_name(BASE)}"
    quality = found.quality
    metric = "PSNR in mask" if found.metric == "mask_psnr" else "PSNR"
    if quality is None:
        text = "no shared view"
    elif quality.samples < 2:
        text = f"{metric} {signed(quality.mean)} dB (one view: no interval)"
    else:
        text = (
            f"{metric} {signed(quality.mean)} dB (95 % interval {signed(quality.low)} to "
            f"{signed(quality.high)}, {quality.samples} paired views)"
        )
    ratios = ((found.size, "size"), (found.time, "time"))
    parts = [f"{name} × {ratio:.2f}" for ratio, name in ratios if ratio is not None]
    return f"{head}: {'; '.join([text, *parts])}."


def _background_saving(mine: Sequence[Cell]) -> str:
    """Say what removing the background changes for plain 3DGS."""
    base = {c.key.background: c for c in mine if c.key.method == BASE and c.finished}
    if base.keys() < {"original", "nobg"}:
        return ""
    size = ratio(base["nobg"], base["original"], "size_mb")
    time = ratio(base["nobg"], base["original"], "time")
    quality = statistics.paired(
        view_scores(base["nobg"], "mask_psnr"), view_scores(base["original"], "mask_psnr")
    )
    parts = [f"PSNR in mask {signed(quality.mean)} dB"] if quality else []
    parts += [f"size × {size:.2f}"] if size else []
    parts += [f"time × {time:.2f}"] if time else []
    return f"Removing the background, with 3DGS: {'; '.join(parts)}."


def summary_line(rows: Sequence[Row]) -> str:
    """Say how many experiments finished, and how long training took in all."""
    rows = refused(rows)
    finished = [row for row in rows if row["status"] == "finished"]
    total = sum(float(row["metrics"]["time"]) for row in finished)
    return (
        f"{len(finished)} of {len(rows)} experiments finished; "
        f"{columns.duration(total)} of training in all."
    )


def facts(rows: Sequence[Row]) -> dict[str, str]:
    """Say under what settings and on what machines the rows came about; label and value."""
    rows = refused(rows)
    origins = [row.get("provenance") or {} for row in rows if row["status"] == "finished"]
    found = {
        "Iterations": {f"{int(row['iterations']):,}" for row in rows},
        "Longest side": {f"{row['resolution']} px" for row in rows},
        "Seeds": {str(row["seed"]) for row in rows},
        "CPU": {str(origin["cpu"]) for origin in origins if origin.get("cpu")},
        "Threads per training": {str(o["threads"]) for o in origins if o.get("threads")},
    }
    return {label: ", ".join(sorted(values)) for label, values in found.items() if values}
