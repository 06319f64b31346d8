"""Single views that keep their own map where the votes make the masks."""

import pytest

from mattgs_ops.object_masks.vote_checks import _unlike_trained

TRAINED = [0.90, 0.80, 0.86, 0.84]  # by votes, where silhouettes meet all maps to 0.9


@pytest.mark.parametrize(
    ("by_votes", "by_outline", "strange"),
    [
        (0.79, 0.9, False),  # the lowest of all five, and of the same kind
        (0.50, 0.9, True),
        (0.50, 0.49, False),  # its map contradicts the silhouettes: it is not counted
        (0.51, 0.5, False),  # splats that are no worse than silhouettes are not worse
    ],
)
def test_a_held_out_view_is_strange_beyond_what_further_views_would_show(
    by_votes: float, by_outline: float, strange: bool
) -> None:
    votes, outlines = [*TRAINED, by_votes], [0.9] * len(TRAINED) + [by_outline]
    assert _unlike_trained(votes, outlines, range(4)) == [False] * 4 + [strange]


def test_views_that_are_trained_on_are_never_strange() -> None:
    assert not any(_unlike_trained([*TRAINED, 0.1], [0.9] * 5, range(5)))


def test_among_many_held_out_views_one_may_be_low_by_chance() -> None:
    """What is strange of one is not of the lowest of thirty."""
    low = 0.70
    assert _unlike_trained([*TRAINED, low], [0.9] * 5, range(4))[-1]
    many = _unlike_trained([*TRAINED, *[0.85] * 29, low], [0.9] * 34, range(4))
    assert not many[-1]


def test_without_training_views_nobody_knows() -> None:
    assert _unlike_trained([0.1], [0.9], []) == [False]
