"""What somebody else wrote stays where the Markdown puts it."""

from reports import markdown

REASON = "5 of 29 photos:\n* IMG_1.jpg | 12 key points\n# none with <others>"


def test_a_reason_stays_in_its_line_and_is_no_tag() -> None:
    expected = "5 of 29 photos: * IMG_1.jpg | 12 key points # none with &lt;others>"
    assert markdown.one_line(REASON) == expected
    assert markdown.items([REASON, "fine"]) == [f"- {expected}", "- fine"]


def test_a_caption_is_no_markup() -> None:
    assert markdown.plain("IMG [1](x) *a*_b_ <b>\\.jpg") == (
        "IMG \\[1\\](x) \\*a\\*\\_b\\_ &lt;b>\\\\.jpg"
    )
    assert markdown.plain("Rover. 1 of 2.") == "Rover. 1 of 2."


def test_a_reason_stays_in_its_cell() -> None:
    cell = markdown.table_cell(REASON)
    assert cell == "5 of 29 photos: * IMG_1.jpg \\| 12 key points # none with &lt;others>"
