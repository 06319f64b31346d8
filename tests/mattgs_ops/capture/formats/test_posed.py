"""What all readers refuse."""

from pathlib import Path

import pytest

from mattgs_ops.capture.formats.posed import path_inside, raise_all
from mattgs_ops.errors import InputError


def test_all_problems_come_in_one_message_up_to_a_limit() -> None:
    raise_all([])
    with pytest.raises(InputError) as error:
        raise_all([f"p{i}" for i in range(25)])
    assert str(error.value).splitlines() == [*(f"p{i}" for i in range(20)), "… and 5 more"]


@pytest.mark.parametrize("name", ["a.jpg", "left/a.jpg", "left/../a.jpg", "..a.jpg"])
def test_names_within_the_folder_pass(tmp_path: Path, name: str) -> None:
    assert path_inside(tmp_path, name, "here") == tmp_path / name


@pytest.mark.parametrize("name", ["..", "../a.jpg", "left/../../a.jpg", "/etc/passwd", "a\0.jpg"])
def test_names_that_lead_out_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"here: .* leads out of"):
        path_inside(tmp_path, name, "here")


def test_a_link_in_the_folder_is_followed(tmp_path: Path) -> None:
    """Who owns the folder made the link; only names in files are not trusted."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "a.jpg").write_bytes(b"x")
    (tmp_path / "capture").mkdir()
    (tmp_path / "capture" / "images").symlink_to(tmp_path / "elsewhere")
    assert path_inside(tmp_path / "capture", "images/a.jpg", "here").read_bytes() == b"x"
