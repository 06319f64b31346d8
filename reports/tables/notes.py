"""What a reader of a table must know: protocol, whose times, missing seeds, the paper's lines."""

from collections.abc import Iterable, Sequence

from reports.rows import columns
from reports.rows.columns import Column
from reports.rows.comparable import protocol_of
from reports.rows.groups import condition_of, finished_of
from reports.rows.schema import (
    Cell,
    Row,
    capture_name,
    captures,
    cells,
    held_out_views,
    method_name,
)
from reports.tables.origins import Origin, cpu_of, measured_on
from reports.tables.paper import PaperValues

FIRST_MASK_NOTE = (  # of protocol 1
    "Scores in mask are means over the object's pixels (SSIM: its map averaged inside the eroded "
    "mask) and compare across backgrounds as well as methods."
)
MASK_NOTE = (
    "Scores in mask are means over the object's pixels. PSNR and L1 compare across backgrounds as "
    "well as methods; SSIM's windows see 5 pixels beyond the object, so that across backgrounds "
    "only SSIM in the core compares."
)
FLIP_NOTE = (
    "FLIP (Andersson et al. 2020) at 67 pixels per degree, 0 to 1, the mean over its map. Its "
    "filters reach some ten pixels and see what stands beside the object: across backgrounds it "
    "does not compare."
)
COLOUR_NOTE = (
    "PSNR colour-corrected is over the full frame, after the affine change of colour that fits the "
    "photo best."
)
NO_LPIPS = (
    "LPIPS is absent: the benchmark's file names no weights for it (`lpips`), and none come with "
    "this project."
)
HAZY = 0.1  # cover from which on a view is hazy: it takes 3 dB from 30 (docs/protocol.md)
MOST_HAZY = 12  # views named in one note
SCORED = {  # whose masks scored, as rows say it
    "exact": "scored by the exact masks that came with the capture",
    "pipeline": "scored by the masks that the pipeline made, as no others are known",
    "both": "some views scored by exact masks, others by those that the pipeline made",
}


def paper_notes(values: PaperValues) -> list[str]:
    """Say where the quoted values were read, and how their protocol differs from ours."""
    source = values.source
    where = ", ".join(str(source[part]) for part in ("title", "year", "url") if source.get(part))
    read = f"Lines marked (paper) quote {where or 'the paper'}; read from {source['read_from']}."
    return [read, *(f"Lines marked (paper): {text}" for text in values.differences)]


def length_notes(values: PaperValues) -> list[str]:
    """Say why a report of other lengths of training prints none of the paper's lines."""
    steps = values.source["iterations"]
    return [f"The paper's values are of {steps:,} iterations: tables of that length print them."]


def protocol_notes(selected: Sequence[Cell]) -> list[str]:
    """Say what was scored against what, over how many seeds, and which lines lack some."""
    rows = finished_of(selected)
    seeds = sorted({int(row["seed"]) for row in rows})
    counts = sorted({len(held_out_views(row)) for row in rows} - {0})
    views = " or ".join(str(count) for count in counts) or "the"
    many = (
        f"mean ± standard deviation over {len(seeds)} seeds"
        if len(seeds) > 1
        else f"one seed ({seeds[0]})"
        if seeds
        else "no finished run"
    )
    notes = [
        (
            f"Full frame, {views} held-out test views, each against its own condition's ground "
            f"truth; {many}. Protocol {_protocol(selected)}."
        )
    ]
    notes += trainer_notes(rows)
    notes += _uneven(selected, seeds)
    if {cell.key.background for cell in selected} >= {"original", "nobg"}:
        notes.append(
            "Scores of No BG do not compare with Original: its white pixels come for free. "
            "The table of scores inside the mask compares them."
        )
    return notes


def trainer_notes(rows: Sequence[Row]) -> list[str]:
    """Say which lines are other programs', and what their times are of."""
    versions_by_trainer: dict[str, set[str]] = {}
    for row in rows:
        trainer = (row.get("provenance") or {}).get("trainer")
        if trainer is not None:
            versions = versions_by_trainer.setdefault(method_name(row["method"]), set())
            versions.add(str(trainer["identity"]["version"]))
    if not versions_by_trainer:
        return []
    named = []
    for name, versions in sorted(versions_by_trainer.items()):
        listed_versions = ", ".join(sorted(versions - {""}))
        named.append(f"{name} ({listed_versions})" if listed_versions else name)
    who = f"Other programs: {', '.join(named)}."
    times = (
        "Their times are of the whole process, which reads the photos, trains and writes; those of "
        "other lines are of the training loop alone. FPS is of this project's renderer for all."
    )
    return [f"{who} {times}"]


def _protocol(selected: Sequence[Cell]) -> str:
    """Return the protocol of the rows; of several, all."""
    return " and ".join(sorted({str(protocol_of(row)) for cell in selected for row in cell.rows}))


def mask_notes(rows: Sequence[Row]) -> list[str]:
    """Say what scores in the mask are means over, which of them compare, and whose masks scored."""
    if not parts_known(rows):
        return [FIRST_MASK_NOTE]
    notes = [MASK_NOTE]
    for scored, text in SCORED.items():
        names = captures(row for row in rows if (row.get("masks") or {}).get("scored") == scored)
        if names:
            notes.append(f"{', '.join(map(capture_name, names))}: {text}.")
    return notes


def perceptual_notes(rows: Sequence[Row]) -> list[str]:
    """Say what the scores of how different renderings look are, and why one is absent."""
    notes = [FLIP_NOTE]
    if not any("lpips" in row["metrics"] for row in rows):
        notes.append(NO_LPIPS)
    if any(columns.COLOUR_CORRECTED.key in row["metrics"] for row in rows):
        notes.append(COLOUR_NOTE)
    return notes


def best_notes(selected: Sequence[Cell], printed: Sequence[Column]) -> list[str]:
    """Say among which lines the best are sought, where a group has both backgrounds."""
    if len({cell.key.background for cell in selected}) < 2:
        return []
    both = [column.label for column in printed if column.across and column.direction]
    if not both:
        return ["Bold is the best of each background."]
    return [f"Bold is the best of both backgrounds in {', '.join(both)}, else of each background."]


def haze_notes(rows: Sequence[Row]) -> list[str]:
    """Name the hazy held-out views: those before whose object a cloud of splats hangs.

    The worst come first, whatever the order of the rows.
    """
    found: list[tuple[float, str]] = []
    for row in (row for cell in cells(rows) for row in cell.finished):
        for view in held_out_views(row):
            cover = view.get("mask_haze")
            cover = view.get("haze") if cover is None else cover
            if cover is not None and cover >= HAZY:
                where = f"{capture_name(row['capture'])}, {method_name(row['method'])} on "
                where += f"{row['background']}, seed {row['seed']}"
                found.append((cover, f"{where}: {view['view']} ({cover:.2f})"))
    if not found:
        return []
    found.sort(key=lambda one: -one[0])  # of equal ones in the order of the tables
    named = "; ".join(text for _, text in found[:MOST_HAZY])
    more = f"; and {len(found) - MOST_HAZY} more" if len(found) > MOST_HAZY else ""
    return [f"Hazy held-out views, with the cover of splats in the air before them: {named}{more}."]


def parts_known(rows: Sequence[Row]) -> bool:
    """Say whether rows score the object's core and rim; those of protocol 1 do not."""
    return any("core_psnr" in row["metrics"] for row in rows)


def _uneven(selected: Sequence[Cell], seeds: Sequence[int]) -> list[str]:
    """Name the lines that lack seeds which others have, and not because those failed."""
    sentences = []
    for cell in selected:
        own = [int(row["seed"]) for row in cell.rows]
        if cell.finished and set(seeds) - set(own):
            finished = _listed(int(row["seed"]) for row in cell.finished)
            few = "seed" if len(cell.finished) == 1 else "seeds"
            sentences.append(f"{condition_of(cell)}: {few} {finished} only.")
    return sentences


def where_timed(members: Sequence[Cell], machine: Origin) -> str:
    """Say whose times a table prints where several machines measured some.

    The seeds named are those that the machine measured of every line, then the lines of which it
    measured others.
    """
    timed = [
        (condition_of(cell), {int(row["seed"]) for row in measured_on(machine, cell.finished)})
        for cell in members
        if cell.finished
    ]
    shared = set.intersection(*(seeds for _, seeds in timed))
    named = [f"{name}: {_listed(seeds)}" for name, seeds in timed if seeds != shared]
    others = "; ".join(dict.fromkeys(named))  # once for all captures
    which = _listed(shared) + (f" ({others})" if others else "") if shared else others
    cpu = cpu_of(measured_on(machine, finished_of(members))[0])
    return (
        f"Times and FPS are those of seeds {which}, from one machine, {cpu}; those from others do "
        "not compare with them."
    )


def _listed(seeds: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(seeds)))
