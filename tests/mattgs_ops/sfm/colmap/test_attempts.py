"""The second attempt asks for more than the first."""

import pytest

from mattgs_ops.config import SfmConfig
from mattgs_ops.sfm.colmap import attempts


@pytest.mark.parametrize(
    ("matcher", "views", "expected"),
    [("auto", 120, "exhaustive"), ("auto", 121, "auto"), ("sequential", 30, "sequential")],
)
def test_a_second_attempt_compares_all_pairs_where_that_is_bearable(
    matcher: str, views: int, expected: str
) -> None:
    first = SfmConfig.model_validate({"matcher": matcher, "upsample": False})
    second = attempts._with_more(first, views)
    assert second.matcher == expected
    assert second.upsample
    assert second.max_features == 2 * first.max_features
    assert second.peak_threshold < first.peak_threshold
