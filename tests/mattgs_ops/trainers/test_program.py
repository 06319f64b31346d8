"""Another program: which one it is, its run, and how far it says it is, in the words of several."""

import sys
import time
from pathlib import Path

import pytest

from mattgs_ops.errors import StageError
from mattgs_ops.trainer import TrainerConfig
from mattgs_ops.trainers.program import environment_of, identify, run, step_of


@pytest.mark.parametrize("code", [0, 3])
def test_it_has_ended_though_what_it_started_holds_its_output(tmp_path: Path, code: int) -> None:
    lines: list[str] = []
    command = ["sh", "-c", f"sleep 20 & echo done; exit {code}"]
    began = time.monotonic()
    if code:
        with pytest.raises(StageError, match="status 3: done"):
            run("peer", command, tmp_path, environment_of(PEER), lines.append)
    else:
        assert run("peer", command, tmp_path, environment_of(PEER), lines.append).wall_seconds < 5
    assert time.monotonic() - began < 19
    assert lines == ["done"]


def test_what_a_listener_raises_ends_it(tmp_path: Path) -> None:
    def refuse(line: str) -> None:
        raise KeyError(line)

    with pytest.raises(KeyError, match="hello"):
        run("peer", ["sh", "-c", "echo hello; sleep 60"], tmp_path, environment_of(PEER), refuse)


def test_two_files_of_one_name_are_both_part_of_what_it_is(tmp_path: Path) -> None:
    files = [tmp_path / folder / "conf.yaml" for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("1")
    trainer = TrainerConfig(command=(sys.executable, *map(str, files)))
    found = [identify("peer", trainer)]
    for file in files:
        file.write_text("2")
        found.append(identify("peer", trainer))
    assert found[0] != found[1] != found[2]


@pytest.mark.parametrize("command", [("./peer.sh", "{data}"), ("sh", "peer.sh")])
def test_a_path_that_leads_nowhere_from_the_folder_it_runs_in_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "peer.sh").write_text("#!/bin/sh\n")
    (tmp_path / "peer.sh").chmod(0o755)
    with pytest.raises(StageError, match=r"trainer peer: peer\.sh is found from this folder alone"):
        identify("peer", TrainerConfig(command=command))
    identify("peer", TrainerConfig(command=(str(tmp_path / "peer.sh"),)))


def test_its_environment_is_filled_in() -> None:
    trainer = TrainerConfig(command=("peer",), environment={"OMP_NUM_THREADS": "{threads}"})
    assert environment_of(trainer, {"threads": 3})["OMP_NUM_THREADS"] == "3"
    told = TrainerConfig(command=("peer",), environment={"CAP": "{budget}"})
    assert told.takes_budget


PEER = TrainerConfig(command=("peer",))


@pytest.mark.parametrize(
    ("line", "step"),
    [
        ("Step 10: 0.213 (1%)", 10),
        ("[ITER 700] Evaluating train", 700),
        ("Training progress:  35%|###   | 350/1000 [00:10<00:20]", 350),
        ("Loading photos 12/42", None),
        ("iteration=42 loss=0.1", 42),
        ("loss=0.012| step: 1,000 of many", 1000),
        ("took 3 s", None),
        ("Step 5000", 1000),
        ("2024/05/01 12:00:00 step 10", 10),
        ("step 10 loss 1/2", 10),
        ("Epoch 1/3 iter 10/1000", 10),
        ("Iteration 10 | views 3/8", 10),
    ],
)
def test_a_step_is_found_in_a_line(line: str, step: int | None) -> None:
    assert step_of(line, 1000, None) == step


def test_a_pattern_of_the_users_goes_before() -> None:
    assert step_of("epoch 3, Step 10", 100, r"epoch (\d+)") == 3
    assert step_of("Step 10", 100, r"epoch (\d+)") is None
