"""What a table of costs prints of stages that several rows share, and of resumed trainings."""

from reports.rows.schema import Row
from reports.tables.formats import Table
from reports.tables.side_tables import cost_table
from tests.reports.conftest import cell_row


def timed(method: str, seed: int, train: float, cpu: str = "A CPU") -> Row:
    """Return a row whose stage of training took so long, with 40 seconds of the loop alone."""
    row = cell_row("rover", "nobg", method, seed)
    row["metrics"]["time"] = 40.0
    row["provenance"]["cpu"] = cpu
    row["seconds"] = {"sfm": 65.0, "train": train}
    return row


def texts(rows: list[Row], stage: str) -> tuple[Table, list[str]]:
    table = cost_table(rows)
    assert table is not None
    place = table.keys.index(stage)
    return table, [line.entries[place].full for group in table.groups for line in group.lines]


def test_a_stage_that_seeds_share_has_no_spread() -> None:
    rows = [timed("ours", 0, 42.0), timed("ours", 1, 44.0)]
    assert texts(rows, "sfm")[1] == ["1m 05s"]
    assert texts(rows, "train")[1] == ["43 s ± 1.4 s"]


def test_the_last_part_of_a_resumed_training_is_not_its_cost() -> None:
    rows = [timed("3dgs", 0, 5.0), timed("ours", 0, 5.0), timed("ours", 1, 44.0)]
    table, trained = texts(rows, "train")
    assert trained == ["–", "44 s"]
    assert any("was resumed" in note for note in table.notes)
    table, _ = texts([timed("3dgs", 0, 42.0)], "train")
    assert not any("was resumed" in note for note in table.notes)


def test_machines_whose_times_are_not_printed_are_not_named() -> None:
    rows = [timed("3dgs", 0, 42.0), timed("ours", 0, 42.0), timed("ours", 1, 42.0, "Another CPU")]
    table, _ = texts(rows, "train")
    (note,) = [text for text in table.notes if text.startswith("Wall time on")]
    assert note.startswith("Wall time on A CPU; threads")
