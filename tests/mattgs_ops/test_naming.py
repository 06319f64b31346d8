"""Names that people give become file names, keys and anchors."""

from mattgs_ops.naming import slug


def test_valid_names_stay_and_other_runs_become_one_dash() -> None:
    assert slug("ours+_2.5-b") == "ours+_2.5-b"
    assert slug("train rover nobg-ours+ seed 0") == "train-rover-nobg-ours+-seed-0"
    assert slug("../../a b/é") == "..-..-a-b-"


def test_what_is_kept_can_be_chosen() -> None:
    assert slug("ours+_2.5", keep="") == "ours-2-5"
    assert slug("ours+_2.5", keep="-_.") == "ours-_2.5"
