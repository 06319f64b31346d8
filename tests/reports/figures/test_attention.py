"""The attention figure: which panels there are, and on whose picture."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from reports.figures import attention
from reports.figures.pictures import gallery
from reports.rows.schema import Row, cells

Pictured = tuple[list[Row], Path]


@pytest.fixture
def copied(pictured: Pictured, tmp_path: Path) -> Pictured:
    """Give the test artifacts of its own, to add files to."""
    rows, root = pictured
    shutil.copytree(root, tmp_path / "artifacts")
    return rows, tmp_path / "artifacts"


def caption(rows: list[Row], root: Path, out: Path) -> str:
    (saved,) = attention.attention([gallery("rover", cells(rows), root)], root, out)
    assert saved.stem.with_suffix(".pdf").stat().st_size > 1000
    assert saved.stem.with_suffix(".png").stat().st_size > 1000
    return saved.caption


def papers_training(rows: list[Row], root: Path) -> Path:
    (row,) = (r for r in rows if r["condition"] == "nobg-ours")
    return root / row["artifacts"]["train"]


def test_without_a_record_of_pruning_the_panels_are_left_out(
    copied: Pictured, tmp_path: Path
) -> None:
    told = caption(*copied, tmp_path / "out")
    assert "eqs. 9–14" in told
    assert "removed during training" not in told


def test_what_was_pruned_before_and_while_training_has_panels(
    copied: Pictured, tmp_path: Path
) -> None:
    rows, root = copied
    train = papers_training(rows, root)
    xyz = np.zeros((3, 3), np.float32)
    np.savez(train / "start.npz", xyz=xyz, kept=np.array([True, False, True]))
    assert "could start from" in caption(rows, root, tmp_path / "one")
    np.savez(train / "pruned.npz", xyz=xyz, step=np.array([100, 200, 200]))
    assert "removed during training" in caption(rows, root, tmp_path / "both")


def test_the_picture_is_the_papers_methods_whatever_else_was_run(
    copied: Pictured, tmp_path: Path
) -> None:
    rows, root = copied
    (paper,) = (r for r in rows if r["condition"] == "nobg-ours")
    more = [*rows, paper | {"condition": "nobg-ours+", "method": "ours+"}]
    np.savez(papers_training(rows, root) / "pruned.npz", xyz=np.zeros((1, 3)), step=np.array([5]))
    assert "removed during training" in caption(more, root, tmp_path / "out")
