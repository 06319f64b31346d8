"""Numbers with signs: a true minus, and none on what rounds to zero."""

import pytest

from reports.rows import columns


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (0.5, 2, "+0.50"),
        (-0.5, 2, "−0.50"),
        (-0.004, 2, "0.00"),
        (0.004, 2, "0.00"),
        (-0.4, 0, "0"),
        (62.0, 0, "+62"),
    ],
)
def test_what_rounds_to_zero_has_no_sign(value: float, decimals: int, text: str) -> None:
    assert columns.signed(value, decimals) == text


def test_signed_times_read_as_times() -> None:
    assert columns.signed_text("time", -61.0) == "−1m 01s"
    assert columns.signed_text("time", 0.01) == "0.0 s"
    assert columns.signed_text("ssim", 0.0104) == "+0.010"
