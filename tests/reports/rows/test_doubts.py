"""Warnings: each once, those that differ in a measured number alone as one with its range."""

from reports.rows.doubts import doubted_note, in_doubt, warnings
from reports.rows.schema import Row
from tests.reports.conftest import cell_row


def warned(capture: str, text: str, *, serious: bool = False) -> Row:
    one = {"about": "exposure", "text": text, "serious": serious}
    return cell_row(capture, "nobg", "ours", warnings=[one])


def test_what_every_training_measures_anew_is_one_sentence_with_its_range() -> None:
    stops = "photos differ in exposure by up to {} stops: compare colour-corrected scores"
    rows = [warned("rover", stops.format(number)) for number in ("9.1", "10.2", "9.4", "9.1")]
    assert warnings([*rows, warned("hexapod", stops.format("0.6"))]) == [
        f"Rover: {stops.format('9.1–10.2')}.",
        f"Hexapod: {stops.format('0.6')}.",
    ]


def test_names_and_limits_are_not_taken_for_measures() -> None:
    rows = [
        warned("rover", "no object was found in 1.05.jpg"),
        warned("rover", "no object was found in 1.06.jpg"),
        warned("rover", "a mean IoU of 0.41, below 0.5", serious=True),
        warned("rover", "a mean IoU of 0.44, below 0.5", serious=True),
    ]
    assert warnings(rows) == [
        "Rover: no object was found in 1.05.jpg.",
        "Rover: no object was found in 1.06.jpg.",
        "Rover: a mean IoU of 0.41–0.44, below 0.5. No verdict is given for it.",
    ]


def test_serious_warnings_alone_put_a_capture_in_doubt() -> None:
    mild, grave = warned("rover", "is dark"), warned("hexapod", "is black", serious=True)
    poses = grave["warnings"][0] | {"about": "poses"}
    again = grave | {"warnings": [*grave["warnings"], poses]}
    assert in_doubt([mild]) == {}
    assert doubted_note({}) == []
    doubted = in_doubt([mild, grave, again])
    assert doubted == {"hexapod": ["exposure", "poses"]}
    assert doubted_note(doubted) == [
        "Means over captures leave out those in doubt: Hexapod (exposure, poses)."
    ]


def test_a_capture_is_in_doubt_where_a_row_was_trained_on_what_it_is_scored_on() -> None:
    healthy = cell_row("rover", "nobg", "ours", trained_on=["a.jpg"])
    leaked = healthy | {"trained_on": ["a.jpg", "0008.jpg"]}
    assert in_doubt([healthy]) == {}
    assert in_doubt([healthy, leaked]) == {"rover": ["held-out views"]}
    (told,) = warnings([leaked])
    assert told.startswith("Rover: nobg-ours was trained on held-out views, such as 0008.jpg. No v")
