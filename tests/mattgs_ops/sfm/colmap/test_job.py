"""What crosses between the program and its worker comes back as it was."""

from pathlib import Path

from mattgs_ops.sfm.colmap.job import Answer, Job, JobView


def test_a_fallback_is_told_once_however_many_attempts_take_it() -> None:
    answer = Answer("shared", fallbacks=["most matches do not move"])
    for fallback in ("most matches do not move", "too few key points", "too few key points"):
        answer.tell(fallback)
    assert answer.fallbacks == ["most matches do not move", "too few key points"]


def test_an_answer_is_read_as_it_was_written(tmp_path: Path) -> None:
    answer = Answer("masked", keypoints={"a.png": (9, 4)}, partners={"a.png": [("b.png", 7)]})
    answer.save(tmp_path)
    assert Answer.load(tmp_path) == answer


def test_exif_s_focal_lengths_are_told_as_cameras_show_them() -> None:
    lens = (500.0, 500.0, 200.0, 150.0)

    def told(*views: tuple[float | None, tuple[float, float, float, float] | None]) -> str:
        rows = tuple(
            JobView("a", "a.png", "a.png", 400, 300, known, None, focal) for focal, known in views
        )
        return Job("", rows, {}, 1).exif_focal

    assert told((None, None)) == ""
    assert told((2890.0, lens)) == ""  # the lens is known
    assert told((2890.0, None), (None, None)) == "EXIF's focal length (250 mm, 35 mm equivalent)"
    assert "(28 to 250 mm," in told((2890.0, None), (324.0, None), (1000.0, None))
