"""What trainings keep: a curve without repeated rows, weights that fit or are refused."""

from pathlib import Path

import pytest
import torch
from torch import nn

from mattgs_ops.errors import InputError
from mattgs_ops.segment.training_state import keep_rows, load_weights, log_row

FIELDS = ("step", "loss")


def test_a_curve_keeps_the_rows_up_to_a_step_once(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    keep_rows(path, FIELDS, 5)
    assert not path.exists()
    for step in (2, 4, 6, 8):
        log_row(path, FIELDS, {"step": step, "loss": step / 10})
    with path.open("a") as file:
        file.write("10")  # a killed process's half line
    keep_rows(path, FIELDS, 5)
    log_row(path, FIELDS, {"step": 6, "loss": 0.7})
    assert path.read_text().splitlines() == ["step,loss", "2,0.2", "4,0.4", "6,0.7"]
    keep_rows(path, FIELDS, 0)
    log_row(path, FIELDS, {"step": 2, "loss": 0.3})
    assert path.read_text().splitlines() == ["step,loss", "2,0.3"]


@pytest.mark.parametrize("state", [{"a": 1}, {1: torch.zeros(1)}, {"weight": 1, "bias": 2}])
def test_weights_of_another_network_are_refused_in_one_line(
    tmp_path: Path, state: dict[object, object]
) -> None:
    torch.save(state, tmp_path / "w.pth")
    with pytest.raises(InputError, match=r"w\.pth: expected the layers of a line: ") as refused:
        load_weights(nn.Linear(1, 1), tmp_path / "w.pth", "a line")
    assert "\n" not in str(refused.value)
