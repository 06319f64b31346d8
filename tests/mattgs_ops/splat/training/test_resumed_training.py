"""A killed training goes on from its checkpoint to the same bits; a finished one is found."""

import csv
from pathlib import Path

import pytest

from mattgs_ops.method import METHODS, MethodConfig
from tests.mattgs_ops.splat.training.conftest import STEPS, KilledError, Train, pruned_of, splats_of


@pytest.mark.parametrize("condition", ["nobg-3dgs", "nobg-blend", "nobg-mcmc"])
def test_a_killed_run_resumes_to_the_same_bits(run: Train, tmp_path: Path, condition: str) -> None:
    blend = MethodConfig(weighting="residual", prune="blend", prune_opacity=0.5)
    options = {"method": blend if condition == "nobg-blend" else METHODS[condition[5:]]}
    whole = run("whole", condition, **options)

    def kill(step: int, total: int, note: str) -> None:
        del total, note
        if step >= 45:
            raise KilledError

    with pytest.raises(KilledError):
        run("killed", condition, progress=kill, **options)
    assert not (tmp_path / "killed" / "training.json").exists()
    resumed = run("killed", condition, **options)
    assert resumed.resumed_from == 40
    assert splats_of(tmp_path / "killed") == splats_of(tmp_path / "whole")
    assert resumed.loss_terms == whole.loss_terms
    assert resumed.counters == whole.counters
    assert pruned_of(tmp_path / "killed") == pruned_of(tmp_path / "whole")
    assert len(pruned_of(tmp_path / "whole")) == whole.counters.get("removed_unattended", 0)
    assert whole.counters["added"] > 0, "the run must have densified for this to mean anything"
    assert not (tmp_path / "killed" / "checkpoint.npz").exists()
    with (tmp_path / "killed" / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["step"]) for row in rows] == list(range(1, STEPS + 1))
    with (tmp_path / "whole" / "curve.csv").open() as file:
        fixed = [row["fixed_psnr"] for row in csv.DictReader(file)]
    assert [row["fixed_psnr"] for row in rows] == fixed
    assert len(set(fixed)) > STEPS / 2, "rendered anew at each row, of which two may round alike"


def test_a_run_killed_after_its_end_is_found_finished(run: Train, tmp_path: Path) -> None:
    first = run("out", "nobg-ours")
    (tmp_path / "out" / "checkpoint.npz").write_bytes(b"the kill came before its removal")
    assert run("out", "nobg-ours") == first, "its seconds too: nothing was trained"
    assert not (tmp_path / "out" / "checkpoint.npz").exists()
    assert run("out", "nobg-3dgs").digest != first.digest


@pytest.mark.parametrize("name", ["splats.ply", "training.json"])
def test_half_a_result_is_made_again(run: Train, tmp_path: Path, name: str) -> None:
    first, before = run("out"), splats_of(tmp_path / "out")
    path = tmp_path / "out" / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run("out") != first
    assert splats_of(tmp_path / "out") == before


def test_a_checkpoint_of_another_training_is_left_alone(run: Train, tmp_path: Path) -> None:
    def kill(step: int, total: int, note: str) -> None:
        del total, note
        if step >= 45:
            raise KilledError

    with pytest.raises(KilledError):
        run("a", progress=kill)
    report = run("a", seed=1)
    assert report.resumed_from == 0
    run("b", seed=1)
    assert splats_of(tmp_path / "a") == splats_of(tmp_path / "b")
