"""What a benchmark's stages say of its experiments, on small grids."""

import pytest

from flows.grid import experiments, stages, without_lost
from mattgs_ops.config import BenchmarkConfig
from tasks.stages.status import State, Status

PLAIN, OURS = "rover nobg-3dgs seed 0", "rover original-ours seed 0"


@pytest.fixture
def grid() -> dict[str, Status]:
    """Return a grid of two captures of which nothing has begun, by title."""
    captures = [{"name": "rover"}, {"name": "hexapod"}]
    conditions = ["nobg-3dgs", "original-ours"]
    config = BenchmarkConfig.model_validate(
        {"name": "b", "captures": captures, "conditions": conditions}
    )
    return {title: Status(title, kind) for kind, title in stages(config)}


def end(grid: dict[str, Status], title: str, state: State) -> None:
    grid[title] = Status(title, grid[title].stage, state)


def states(grid: dict[str, Status]) -> dict[str, str]:
    of_both = {one.name: one.state for one in experiments(list(grid.values()))}
    return {name: state for name, state in of_both.items() if name.startswith("rover")}


def lost(grid: dict[str, Status]) -> set[str]:
    return grid.keys() - {one.title for one in without_lost(list(grid.values()))}


def test_an_experiment_is_what_its_stages_are(grid: dict[str, Status]) -> None:
    assert states(grid) == {PLAIN: "waiting", OURS: "waiting"}
    for title in ("prepare rover", "segment rover", "sfm rover", "agree rover"):
        end(grid, title, "cached")
    assert states(grid) == {PLAIN: "running", OURS: "running"}
    for cell in (PLAIN, OURS):
        end(grid, f"train {cell}", "cached")
        end(grid, f"evaluate {cell}", "cached")
    for title in ("truth rover nobg", "truth rover original", "measure rover"):
        end(grid, title, "cached")
    assert states(grid) == {PLAIN: "cached", OURS: "cached"}
    end(grid, f"evaluate {PLAIN}", "done")
    assert states(grid) == {PLAIN: "done", OURS: "cached"}
    end(grid, f"train {OURS}", "failed")
    assert states(grid) == {PLAIN: "done", OURS: "failed"}
    end(grid, "sfm rover", "failed")
    assert states(grid) == {PLAIN: "failed", OURS: "failed"}


def test_nothing_of_a_capture_without_poses_will_run(grid: dict[str, Status]) -> None:
    assert lost(grid) == set()
    end(grid, "prepare rover", "done")
    end(grid, "segment rover", "done")
    end(grid, "sfm rover", "failed")
    ended = {"prepare rover", "segment rover", "sfm rover"}
    assert lost(grid) == {title for title in grid if "rover" in title} - ended


def test_a_training_that_failed_takes_along_what_nobody_else_needs(
    grid: dict[str, Status],
) -> None:
    for title in ("prepare rover", "segment rover", "sfm rover", "agree rover"):
        end(grid, title, "done")
    end(grid, f"train {OURS}", "failed")
    assert lost(grid) == {f"evaluate {OURS}", "truth rover original"}, "speed is measured of 3DGS"
    end(grid, f"train {PLAIN}", "failed")
    assert "measure rover" in lost(grid)
