"""Rows with pictures on disk, as the tests of reports make them, and what a run keeps of them."""

from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.capture.scene import Scene
from mattgs_ops.segment import sheet
from tasks.registry import record
from tests.reports.conftest import pictured, rough_figures

__all__ = ["pictured", "rough_figures"]

Row = dict[str, Any]
# a row's names → stages
STAGES = {"train": ("train",), "evaluate": ("evaluate",), "scene": ("sfm", "agree")}


@pytest.fixture(autouse=True)
def embedded_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


def files_of(row: Row, root: Path, copies: Path) -> list[tuple[Path, str]]:
    """List what a run keeps of a row's folders, by the table that the real thing goes by."""
    found: list[tuple[Path, str]] = []
    for name, stages in STAGES.items():
        folder = root / row["artifacts"][name]
        kept = {file: place for stage in stages for file, place in record.KEPT[stage].items()}
        found += [(folder / f, place) for f, place in kept.items() if (folder / f).exists()]
    scene = Scene.load(root / row["artifacts"]["scene"])
    view = scene.example_view()
    assert view is not None
    assert view.mask is not None
    sheet.write_copies(scene.folder, copies)
    found += [(copies, f"scene/{sheet.FOLDER}")]
    return [*found, (view.photo, "scene/photos"), (view.mask, "scene/masks")]
