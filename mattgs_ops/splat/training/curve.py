"""The training curve, ``curve.csv``: a few hundred rows, written in batches.

Columns: ``step``; ``loss`` (what is optimised), ``l1`` (plain), ``ssim`` and ``psnr`` of the step's
own training view before the step; ``splats``; ``steps_per_second`` since the row before;
``fixed_psnr`` of one and the same training view after the step, in dB: the smooth one.
"""

import csv
from dataclasses import astuple, dataclass, fields
from pathlib import Path

FILE = "curve.csv"
BATCH = 10  # rows; whoever follows a training sees it this often
ROWS = 200  # at most about this many per run
FEWEST_ROWS = 50  # at least about this many, where there are as many steps
SPACING = 20  # steps between rows of short runs: each row renders a view that no step renders


@dataclass(frozen=True)
class CurveRow:
    """One row; units as in the module's docstring."""

    step: int
    loss: float
    l1: float
    ssim: float
    psnr: float
    splats: int
    steps_per_second: float
    fixed_psnr: float


class Curve:
    """Appends to ``folder/curve.csv``, keeping the rows of an earlier part up to ``step``."""

    def __init__(self, folder: Path, step: int) -> None:
        self._path = folder / FILE
        self._rows: list[CurveRow] = []
        kept = _rows_until(self._path, step)
        with self._path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([f.name for f in fields(CurveRow)])
            writer.writerows(kept)

    def add(self, row: CurveRow) -> None:
        """Take a row; it reaches the file with its batch."""
        self._rows.append(row)
        if len(self._rows) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what was added."""
        with self._path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows([_rounded(row) for row in self._rows])
        self._rows.clear()


def due(step: int, iterations: int) -> bool:
    """Tell whether ``step`` gets a row: the first, the last, and evenly between."""
    spacing = max(1, iterations // ROWS, min(SPACING, iterations // FEWEST_ROWS))
    return step in (1, iterations) or step % spacing == 0


def _rounded(row: CurveRow) -> list[str]:
    return [f"{value:.6g}" if isinstance(value, float) else str(value) for value in astuple(row)]


def _rows_until(path: Path, step: int) -> list[list[str]]:
    if step == 0 or not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    # a killed process may have left half a line at the end
    complete = [row for row in rows if len(row) == len(fields(CurveRow))]
    return [row for row in complete if int(row[0]) <= step]
