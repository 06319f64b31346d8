"""Baselines: read back what was written, notice edits, and come up from older schemas."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mattgs_ops.errors import InputError
from reports.gate import baseline
from reports.gate.compare import compare
from reports.gate.findings import Exit
from reports.rows.schema import problems

Row = dict[str, Any]


def test_what_is_read_is_what_was_written(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    made = baseline.make(make_grid(), "quick", {"time": 0.02})
    path = tmp_path / "deep" / "quick.json"
    made.save(path)
    read = baseline.load(path)
    assert read == made
    assert read.machine["cpu"] == ["A CPU"]
    assert compare(make_grid(), read.rows, noise=read.noise).exit_code == Exit.PASS
    again = tmp_path / "again.json"
    read.save(again)
    assert again.read_bytes() == path.read_bytes()


def test_a_baseline_that_cannot_be_written_leaves_the_one_before(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    path = tmp_path / "quick.json"
    path.write_text("before")
    (tmp_path / "quick.json.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        baseline.make(make_grid(), "quick", {"time": 0.02}).save(path)
    assert path.read_text() == "before"


def test_training_views_keep_their_names_only(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "nobg", "3dgs")
    row["per_view"].append({"view": "0001.jpg", "split": "train", "psnr": 30.0})
    (kept,) = baseline.make([row], "quick").rows
    assert kept["per_view"][-1] == {"view": "0001.jpg", "split": "train"}
    assert problems([kept]) == []


def test_a_number_edited_by_hand_is_noticed(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    path = tmp_path / "quick.json"
    baseline.make(make_grid(), "quick").save(path)
    document = json.loads(path.read_text())
    document["rows"][0]["metrics"]["psnr"] -= 1
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="digest differs"):
        baseline.load(path)


def test_version_1_is_migrated(make_grid: Callable[..., list[Row]], tmp_path: Path) -> None:
    rows = make_grid()
    path = tmp_path / "old.json"
    path.write_text(json.dumps({"schema": 1, "name": "old", "rows": rows}))
    read = baseline.load(path)
    assert (read.name, read.protocol, dict(read.noise)) == ("old", 1, {})
    assert list(read.rows) == rows
    read.save(tmp_path / "new.json")
    assert json.loads((tmp_path / "new.json").read_text())["schema"] == baseline.SCHEMA


def test_version_2_is_migrated(make_grid: Callable[..., list[Row]], tmp_path: Path) -> None:
    rows = make_grid()
    machine = {"cpu": ["A CPU"], "threads": ["1"], "code_version": ["0.1.0"], "git": []}
    document = {
        "schema": 2,
        "name": "quick",
        "protocol": 1,
        "rows": rows,
        "rows_digest": baseline.digest(rows),
        "machine": machine,
        "noise": {"psnr": 0.05},
    }
    path = tmp_path / "old.json"
    path.write_text(json.dumps(document))
    read = baseline.load(path)
    assert read.machine["cpu"] == ["A CPU"]
    assert "code_version" not in read.machine
    assert read.made_by["code_version"] == ["0.1.0"]
    assert read.calibration == 0.5
    assert (dict(read.noise), list(read.rows)) == ({"psnr": 0.05}, rows)
    assert compare(rows, read.rows, noise=read.noise).exit_code == Exit.PASS
    made = baseline.make(rows, "quick")
    assert (read.machine, read.made_by) == (made.machine, made.made_by), "as if made now"


def test_what_made_it_has_a_digest(make_grid: Callable[..., list[Row]]) -> None:
    rows = make_grid()
    first = baseline.make(rows, "quick").made_by
    rows[0]["provenance"] = rows[0]["provenance"] | {"code_version": "0.2.0"}
    second = baseline.make(rows, "quick").made_by
    assert second["code_version"] == ["0.1.0", "0.2.0"]
    assert first["digest"] != second["digest"]


def test_the_calibration_is_the_median_over_rows(make_row: Callable[..., Row]) -> None:
    rows = [make_row("rover", "nobg", "3dgs", seed) for seed in range(3)]
    for row, seconds in zip(rows, (0.5, 0.6, 9.0), strict=True):
        row["provenance"] |= {"calibration": {"seconds": seconds}}
    assert baseline.make(rows, "quick").calibration == 0.6
    for row in rows:
        row["provenance"]["calibration"] = None
    assert baseline.make(rows, "quick").calibration is None


def test_noise_is_how_runs_of_the_same_code_differ(make_row: Callable[..., Row]) -> None:
    def run(shift: float) -> list[Row]:
        row = make_row("rover", "nobg", "3dgs")
        for view in row["per_view"]:
            view["psnr"] += shift
        return [row]

    noise = baseline.measured_noise([run(0.0), run(0.2)])
    assert noise["psnr"] == pytest.approx(0.2 / 2**0.5, rel=1e-4)
    assert "ssim" not in noise, "the same to the bit says nothing of how much it could differ"
    assert "time" not in noise, "speed's noise is the machine's, not the code's"
    with pytest.raises(InputError, match="two comparable runs"):
        baseline.measured_noise([run(0.0)])
    with pytest.raises(InputError, match="runs that differ"):
        baseline.measured_noise([run(0.0), run(0.0)])


def test_noise_is_a_root_mean_square_over_seeds_and_pairs_of_runs(
    make_row: Callable[..., Row],
) -> None:
    def run(*shifts: float) -> list[Row]:
        rows = [make_row("rover", "nobg", "3dgs", seed) for seed in range(len(shifts))]
        for row, shift in zip(rows, shifts, strict=True):
            for view in row["per_view"]:
                view["psnr"] += shift
        return rows

    noise = baseline.measured_noise([run(0.0, 0.0), run(0.3, 0.0), run(0.0, 0.1)])
    # of the six changes, two seeds in three pairs of runs, two are none
    mean_square = (0.3**2 + 0.1**2 + 0.3**2 + 0.1**2) / 4
    assert noise["psnr"] == pytest.approx((mean_square / 2) ** 0.5, abs=1e-6)


def test_a_baseline_made_anew_keeps_its_noise(
    make_grid: Callable[..., list[Row]], tmp_path: Path
) -> None:
    path = tmp_path / "quick.json"
    assert baseline.kept_noise(path, "quick") == {}
    baseline.make(make_grid(), "quick", {"psnr": 0.05}).save(path)
    assert baseline.kept_noise(path, "quick") == {"psnr": 0.05}
    assert baseline.kept_noise(path, "other") == {}


def text_of(rows: object, **changes: object) -> str:
    """Return the text of a baseline of this version whose rows, or more, may be anything."""
    digest = baseline.digest([])
    made = vars(baseline.Baseline("b", ())) | {"schema": baseline.SCHEMA, "rows_digest": digest}
    return json.dumps(made | {"rows": rows} | changes, ensure_ascii=False)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("{", "readable"),
        ("[]", "with `rows`"),
        ('{"schema": 4, "rows": []}', "schema 1 to 3, found 4"),
        ('{"schema": "2", "rows": []}', "found '2'"),
        ('{"schema": 2, "rows": []}', "expected name, noise, protocol"),
        (text_of([], name="Gerät"), "'utf-8' codec can't decode"),
        ('{"schema": 1, "rows": [3]}', "row 0: expected a row, found int"),
        ('{"schema": 1, "rows": [{"provenance": []}]}', "row 0: `provenance`: expected an object"),
        ('{"schema": 1, "rows": [{"psnr": NaN}]}', "expected finite numbers"),
        (text_of([3]), "row 0: expected a row, found int"),
        (text_of([{"psnr": math.nan}]), "expected finite numbers"),
        (text_of([], calibration=math.inf), "expected finite numbers"),
        (text_of([], calibration="fast"), "found `calibration` 'fast'"),
        (text_of([], noise="much"), "`noise`: expected a number of 0 or more"),
        (text_of([], noise={"psnr": "0.1"}), "`noise`: expected a number of 0 or more"),
        (text_of([], noise={"psnr": -0.1}), "`noise`: expected a number of 0 or more"),
        (text_of([], noise={"psnr": math.nan}), "`noise`: expected a number of 0 or more"),
    ],
)
def test_what_is_no_baseline_is_refused_by_name(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "b.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"b\.json") as caught:
        baseline.load(path)
    assert word in str(caught.value)


def test_an_unknown_name_lists_the_committed_ones() -> None:
    with pytest.raises(InputError, match="committed ones"):
        baseline.load("no-such-baseline")


def test_bad_rows_make_no_baseline(make_row: Callable[..., Row]) -> None:
    row = make_row("rover", "nobg", "3dgs")
    del row["metrics"]["psnr"]
    with pytest.raises(InputError, match=r"metrics\.psnr"):
        baseline.make([row], "quick")
    with pytest.raises(InputError, match="there are none"):
        baseline.make([], "quick")
    row = make_row("rover", "nobg", "3dgs")
    row["per_view"][1]["psnr"] = math.inf
    with pytest.raises(InputError, match=r"row 0 \(.*\): psnr of 0008.jpg is inf"):
        baseline.make([row], "quick")


def test_a_run_of_which_nothing_finished_makes_no_baseline(make_row: Callable[..., Row]) -> None:
    failed = make_row("rover", "nobg", "3dgs", status="failed", reason="train: out of memory")
    with pytest.raises(InputError, match="failed: train: out of memory"):
        baseline.make([failed], "quick")
    finished = make_row("rover", "nobg", "ours")
    for one in (failed, failed | {"metrics": None, "per_view": None, "provenance": None}):
        assert len(baseline.make([one, finished], "quick").rows) == 2


def test_every_committed_baseline_can_be_read() -> None:
    for path in baseline.FOLDER.glob("*.json"):
        assert problems(baseline.load(path).rows) == []


def test_only_names_are_looked_up_among_the_committed_ones() -> None:
    assert baseline.committed("quick-ci")
    assert not baseline.committed("../baselines/quick-ci")
    with pytest.raises(InputError, match="expected a readable baseline"):
        baseline.load("../baselines/quick-ci")


def test_rows_of_a_baseline_that_lead_elsewhere_are_refused(tmp_path: Path) -> None:
    rows = [dict(row) for row in baseline.load("quick-ci").rows]
    rows[1]["artifacts"] = {"evaluate": "../../../home"}
    path = tmp_path / "evil.json"
    baseline.Baseline("evil", tuple(rows)).save(path)
    with pytest.raises(InputError, match=r"evil.json: row 1: `artifacts.evaluate`: expected"):
        baseline.load(path)
