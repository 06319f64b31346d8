"""Cells in groups, as tables print them, and the names of their lines."""

from collections.abc import Sequence

from reports.rows.schema import Cell, Row, capture_name, condition_name, limited, method_name


def finished_of(selected: Sequence[Cell]) -> list[Row]:
    """List the rows that finished."""
    return [row for cell in selected for row in cell.finished]


def by_capture(selected: Sequence[Cell]) -> list[tuple[str, list[Cell]]]:
    """Group cells by the printed name of their capture."""
    grouped: dict[str, list[Cell]] = {}
    for cell in selected:
        grouped.setdefault(capture_name(cell.key.capture), []).append(cell)
    return list(grouped.items())


def condition_of(cell: Cell) -> str:
    """Return a cell's condition as printed."""
    return limited(condition_name(cell.key.background, cell.key.method), cell.key.budget)


def method_of(cell: Cell) -> str:
    """Return a cell's method as printed."""
    return limited(method_name(cell.key.method), cell.key.budget)
