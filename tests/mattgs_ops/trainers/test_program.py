"""How far a program says it is, in the words of several."""

import pytest

from mattgs_ops.trainers.program import step_of


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
    ],
)
def test_a_step_is_found_in_a_line(line: str, step: int | None) -> None:
    assert step_of(line, 1000, None) == step


def test_a_pattern_of_the_users_goes_before() -> None:
    assert step_of("epoch 3, Step 10", 100, r"epoch (\d+)") == 3
    assert step_of("Step 10", 100, r"epoch (\d+)") is None
