"""The view that changed most, for a gate's summary: truth, before, after and where it is wrong."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from reports.figures import pictures
from reports.figures.pictures import Floats, Gallery
from reports.gate.findings import Finding, GateReport, Verdict
from reports.rows.schema import Row, cells, refused

MOST = 3  # pictures in a summary
ERROR_GAIN = 4.0  # an error of a quarter is white
GAP = 4  # pixels between panels


def draw(
    report: GateReport,
    candidate: Sequence[Row],
    root: Path | None,
    folder: Path,
    *,
    baseline: Sequence[Row] = (),
    baseline_root: Path | None = None,
) -> list[tuple[str, str]]:
    """Draw the views of the worst findings into ``folder``; returns (caption, file name).

    The baseline's own render is drawn where its artifacts are still on this disk. Findings without
    pictures are left out here: the table names them.
    """
    out: list[tuple[str, str]] = []
    drawn: set[tuple[str, str]] = set()
    for finding in report.findings:
        view = finding.worst_view
        if finding.verdict != Verdict.WORSE or view is None or (finding.cell, view) in drawn:
            continue
        after = _render(finding, candidate, root)
        if after is None:
            continue
        before = _render(finding, baseline, baseline_root)
        name = f"gate-{len(out) + 1}.png"
        folder.mkdir(parents=True, exist_ok=True)
        _panels(after, before).save(folder / name)
        panels = "truth, before, after, error" if before else "truth, after, error"
        out.append((f"{finding.cell}, view {view}: {panels} (× {ERROR_GAIN:.0f})", name))
        drawn.add((finding.cell, view))
        if len(out) == MOST:
            break
    return out


def _render(
    finding: Finding, rows: Sequence[Row], root: Path | None
) -> tuple[Floats, Floats] | None:
    """Return (truth, render) of a finding's worst view, None where they are not on this disk."""
    mine = [cell for cell in cells(refused(rows)) if str(cell.key) == finding.cell]
    if not mine or finding.worst_view is None:
        return None
    key = mine[0].key
    gallery: Gallery = pictures.gallery(key.capture, mine, root)
    if (key.condition, finding.worst_view) not in gallery.renders:
        return None
    view = finding.worst_view
    return gallery.truth(key.condition, view), gallery.render(key.condition, view)


def _panels(after: tuple[Floats, Floats], before: tuple[Floats, Floats] | None) -> Image.Image:
    truth, render = after
    wrong = np.repeat(pictures.error(render, truth)[:, :, None] * ERROR_GAIN, 3, axis=2)
    parts = [truth, *([before[1]] if before else []), render, wrong]
    gap = np.ones((truth.shape[0], GAP, 3), np.float32)
    strip = [piece for part in parts for piece in (part, gap)][:-1]
    pixels = np.rint(np.clip(np.concatenate(strip, axis=1), 0, 1) * 255).astype(np.uint8)
    return Image.fromarray(pixels)
