"""Every figure of a report, each a part that can be drawn by itself, in a process of its own.

A figure with photos takes a second of one core as PNG and PDF, and no figure needs another.
"""

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from reports.figures import attention, mask_sheets, photos, plots, trade_off
from reports.figures.pictures import Gallery
from reports.figures.plots import Saved
from reports.rows.schema import Row, captures, cells

Part = Callable[[], Sequence[Saved] | Saved | None]  # None: what it would show is not there


def parts(
    rows: Sequence[Row],
    galleries: Sequence[Gallery],
    root: Path | None,
    folder: Path,
    *,
    points: bool,
) -> list[Part]:
    """Return what draws a report's figures into ``folder``, in their order on the page.

    ``root`` is the folder that rows' artifacts are relative to; with ``points`` single points of
    quality and cost are among the figures.
    """
    finished = {
        cell.key.capture: cell.finished[0] for cell in reversed(cells(rows)) if cell.finished
    }
    solved = [(one.capture, finished[one.capture]) for one in galleries if one.capture in finished]
    return [
        partial(photos.masked_sfm, solved, root, folder),
        partial(attention.attention, galleries, root, folder),
        *(
            partial(draw, found, folder)
            for found in galleries
            for draw in (photos.comparison, photos.error_maps)
        ),
        *(partial(mask_sheets.sheet, rows, name, root, folder) for name in captures(rows)),
        *([partial(trade_off.trade_offs, rows, folder)] if points else []),
        partial(plots.training_curves, rows, root, folder),
    ]


@contextmanager
def drawn_by(processes: int, wanted: Sequence[Part]) -> Iterator[Callable[[], list[Saved]]]:
    """Yield a function that waits for all figures; more ``processes`` than one begin at once."""
    if processes < 2:
        yield lambda: [saved for part in wanted for saved in _draw(part)]
        return
    # a fork of a process with threads may hang
    context = get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(wanted)), context, _spare_ctrl_c) as pool:
        begun = [pool.submit(_draw, part) for part in wanted]
        yield lambda: [saved for future in begun for saved in future.result()]


def _spare_ctrl_c() -> None:
    """Leave Ctrl-C, which a terminal sends to all, to the process that waits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _draw(part: Part) -> list[Saved]:
    with plots.style():
        drawn = part()
    if drawn is None:
        return []
    return [drawn] if isinstance(drawn, Saved) else list(drawn)
