"""What a figure shows, as one sentence for its caption: who comes first, by how much, where."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from statistics import fmean

from reports.figures.pictures import Gallery
from reports.rows.columns import joined, text
from reports.rows.doubts import in_doubt
from reports.rows.schema import BACKGROUNDS, Cell, capture_name, held_out_views, method_name

WHERE = {"nobg": "without its background", "original": "with its background"}
OVER_ALL = {"nobg": "without background", "original": "with background"}
PREFERRED = ("nobg", "original")  # plots have one sentence: of the paper's proposal, where it ran


def on_views(found: Gallery, views: Sequence[str], error: bool = False) -> str:
    """Say which method is nearest to the ground truth on the views that a figure shows.

    By PSNR inside the mask, or with ``error`` by L1 there; over the full frame where there is no
    mask. Empty where a score is missing.
    """
    sentences: dict[str, list[str]] = {}
    name = "l1" if error else "psnr"
    for background in (b for b in BACKGROUNDS if _conditions(found, b)):
        conditions = _conditions(found, background)
        for metric, where in ((f"mask_{name}", "inside the mask"), (name, "over the full frame")):
            scores = {
                method_name(found.rows[c]["method"]): score
                for c in conditions
                if (score := _mean(found, c, views, metric)) is not None
            }
            if len(scores) == len(conditions):
                claim, numbers = _ranked(scores, where, error)
                sentences.setdefault(claim, []).append(f"{WHERE[background]} {numbers}")
                break
    if not sentences:
        return ""
    claims = [f"{claim}: {', '.join(numbers)}" for claim, numbers in sentences.items()]
    return f"On these views {'; '.join(claims)}. "


def _ranked(scores: Mapping[str, float], where: str, error: bool) -> tuple[str, str]:
    """Return what the best does, and its score with the others' in brackets.

    What is printed alike is equal.
    """
    kind, unit = ("l1", "") if error else ("db", " dB")
    printed = {method: text(kind, score) for method, score in scores.items()}
    top = printed[(min if error else max)(scores, key=scores.__getitem__)]
    best = [method for method, shown in printed.items() if shown == top]
    rest = ", ".join(f"{method} {shown}" for method, shown in printed.items() if shown != top)
    if len(scores) == 1:
        claim = "mean error" if error else "PSNR"
        return f"{claim} {where} is", f"{top}{unit}"
    who = joined(best)
    if not rest:
        claim = "have the same mean error" if error else "are equally near to the ground truth"
        return f"{who} {claim} {where}", f"{top}{unit}"
    verb, many = ("has", "have") if error else ("is", "are")
    claim = "the smallest mean error" if error else "nearest to the ground truth"
    return f"{who} {verb if len(best) == 1 else many} {claim} {where}", f"{top}{unit} ({rest})"


def _conditions(found: Gallery, background: str) -> list[str]:
    return [c for c in found.conditions if found.rows[c]["background"] == background]


def _mean(found: Gallery, condition: str, views: Sequence[str], metric: str) -> float | None:
    scored = {str(view["view"]): view for view in held_out_views(found.rows[condition])}
    values = [scored.get(view, {}).get(metric) for view in views]
    known = [float(value) for value in values if isinstance(value, int | float)]
    return fmean(known) if len(known) == len(views) and known else None


def winners(
    selected: Sequence[Cell],
    names: Sequence[str],
    what: str,
    value: Callable[[Cell], float | None],
    kind: str,
) -> str:
    """Say on how many of the captures each method has the largest ``value``, as ``what``.

    Of the first background of :data:`PREFERRED` that several methods share; empty for none.
    Captures in doubt do not count. What a column of this ``kind`` prints alike is equal.
    """
    doubted = in_doubt([row for cell in selected for row in cell.rows])
    names = [name for name in names if name not in doubted]
    for background in PREFERRED:
        first: Counter[str] = Counter()  # by who comes first
        for name in names:
            scores = {
                cell.key.method: score
                for cell in selected
                if (cell.key.capture, cell.key.background) == (name, background)
                and (score := value(cell)) is not None
            }
            if len(scores) > 1:
                printed = {method: text(kind, abs(score)) for method, score in scores.items()}
                first[_best(printed, printed[max(scores, key=scores.__getitem__)])] += 1
        if first:
            return f"{what} {OVER_ALL[background]}: {_counts(first, names)}. "
    return ""


def _best(printed: Mapping[str, str], top: str) -> str:
    """Name the methods that print ``top``; all of them are merely equal."""
    best = [method_name(method) for method, shown in printed.items() if shown == top]
    if len(best) == len(printed):
        return "equal"
    return best[0] if len(best) == 1 else f"{joined(best)} equal"


def _counts(first: Counter[str], names: Sequence[str]) -> str:
    total = sum(first.values())
    if total == 1:
        only = f" on {capture_name(names[0])}" if len(names) == 1 else " on the one that compares"
        return f"{next(iter(first))}{only}"
    sentences = [f"{who} on {count} of {total}" for who, count in first.most_common()]
    return ", ".join(sentences) + " captures"
