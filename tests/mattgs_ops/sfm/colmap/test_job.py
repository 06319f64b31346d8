"""What crosses between the program and its worker comes back as it was."""

from pathlib import Path

from mattgs_ops.sfm.colmap.job import Answer


def test_a_fallback_is_told_once_however_many_attempts_take_it() -> None:
    answer = Answer("shared", fallbacks=["most matches do not move"])
    for fallback in ("most matches do not move", "too few key points", "too few key points"):
        answer.tell(fallback)
    assert answer.fallbacks == ["most matches do not move", "too few key points"]


def test_an_answer_is_read_as_it_was_written(tmp_path: Path) -> None:
    answer = Answer("masked", keypoints={"a.png": (9, 4)}, partners={"a.png": [("b.png", 7)]})
    answer.save(tmp_path)
    assert Answer.load(tmp_path) == answer
