"""A report is built again where anything that it is made of changed, and left alone elsewhere."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from reports.figures import all_figures
from reports.page import build as building
from reports.page import unchanged

Row = dict[str, Any]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Count instead of drawing the figures."""
    calls: list[str] = []

    def draw(*_: object, **__: object) -> list[Any]:
        calls.append("drawn")
        return []

    monkeypatch.setattr(all_figures, "parts", draw)
    return calls


@pytest.fixture
def again(
    drawn: list[str], pictured: tuple[list[Row], Path], tmp_path: Path
) -> Callable[..., bool]:
    """Return a function that builds into one folder and says whether anything was drawn."""
    rows, root = pictured

    def build(rows: list[Row] = rows, title: str = "Toy", root: Path | None = root) -> bool:
        drawn.clear()
        path = building.build(rows, tmp_path, title=title, artifacts_root=root)
        assert path.is_file()
        return bool(drawn)

    return build


def test_the_same_report_is_left_alone(
    again: Callable[..., bool], pictured: tuple[list[Row], Path]
) -> None:
    assert again()
    assert not again()
    assert not again(rows=pictured[0][::-1])


def test_other_rows_another_title_or_artifacts_that_are_gone_build_it_again(
    again: Callable[..., bool], pictured: tuple[list[Row], Path]
) -> None:
    rows = pictured[0]
    assert again()
    assert again(title="Other")
    faster = rows[0] | {"metrics": rows[0]["metrics"] | {"fps": 1.5}}
    assert again(title="Other", rows=[faster, *rows[1:]])
    assert again(title="Other", rows=[faster, *rows[1:]], root=None)


def test_a_file_that_was_changed_or_removed_is_built_again(
    again: Callable[..., bool], tmp_path: Path
) -> None:
    assert again()
    (tmp_path / "report.md").unlink()
    assert again()
    (tmp_path / "tables" / "table-1-rover.md").write_text("mine")
    assert again()
    (tmp_path / unchanged.FILE).write_text("{")
    assert again()
    assert not again()


def test_other_code_builds_it_again(
    again: Callable[..., bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert again()
    monkeypatch.setattr(unchanged, "_sources", lambda: {"reports/page/page.py": "0" * 64})
    assert again()
