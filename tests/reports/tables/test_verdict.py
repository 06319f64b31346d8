"""Sentences on what a method gains: in words, per capture and over all of them."""

from collections.abc import Callable

import pytest

from reports.rows.schema import Row
from reports.tables import verdict


def pair(make_row: Callable[..., Row], shifts: list[float], **metrics: float) -> list[Row]:
    plain, ours = make_row("rover", "nobg", "3dgs"), make_row("rover", "nobg", "ours")
    plain["metrics"] |= {"size_mb": 4.0, "time": 100.0}
    ours["metrics"] |= {"size_mb": 4.0, "time": 100.0} | metrics
    for view, base, shift in zip(ours["per_view"], plain["per_view"], shifts, strict=True):
        view["mask_psnr"] = base["mask_psnr"] + shift
    return [plain, ours]


def test_a_gain_is_called_one_only_beyond_doubt(make_row: Callable[..., Row]) -> None:
    clear = verdict.verdicts(pair(make_row, [0.4, 0.5, 0.6, 0.5, 0.4, 0.6]))[0].headline
    assert "gains 0.50 dB inside the mask over 3DGS at the same size and time" in clear
    doubtful = verdict.verdicts(pair(make_row, [1.5, -0.5, 1.6, -0.5, 0.4, 0.6]))[0].headline
    assert "does not measurably differ inside the mask (+0.52 dB) from 3DGS" in doubtful
    loss = verdict.verdicts(pair(make_row, [-0.3] * 6, size_mb=3.0, time=110.0))[0].headline
    assert "loses 0.30 dB" in loss
    assert "a 25 % smaller file and 10 % more training time" in loss


def of_seed(seed: int, row: Row, views: int, shift: float) -> Row:
    """Return the row as one of another seed with fewer views, which rounding moved a little."""
    kept = [view | {"mask_psnr": view["mask_psnr"] + shift} for view in row["per_view"][:views]]
    return row | {"seed": seed, "per_view": kept}


@pytest.mark.parametrize(
    ("views", "claim", "evidence"),
    [
        (1, "cannot be told apart by one view", "PSNR in mask +0.51 dB (one view: no interval)"),
        (6, "gains 0.51 dB", "6 paired views)"),
    ],
)
def test_seeds_are_no_views(
    make_row: Callable[..., Row], views: int, claim: str, evidence: str
) -> None:
    plain, ours = pair(make_row, [0.5] * 6)
    rows = [of_seed(seed, plain, views, 0.0) for seed in range(3)]
    rows += [of_seed(seed, ours, views, 0.01 * seed) for seed in range(3)]
    found = verdict.verdicts(rows)[0]
    assert claim in found.headline
    assert evidence in found.details[0]


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (0.991, "at the same size and time"),
        (0.989, "a 1 % smaller file"),
        (1.009, "at the same size and time"),
        (1.011, "a 1 % larger file"),
    ],
)
def test_a_difference_below_one_percent_is_called_none(
    make_row: Callable[..., Row], size: float, words: str
) -> None:
    assert words in verdict.verdicts(pair(make_row, [0.5] * 6, size_mb=4 * size))[0].headline


def test_what_prints_as_zero_is_neither_gain_nor_loss(make_row: Callable[..., Row]) -> None:
    def captures(shift: float) -> list[Row]:
        rows = pair(make_row, [shift] * 6)
        return [row | {"capture": name} for name in ("a", "b") for row in rows]

    tiny, real = captures(-0.004), captures(-0.006)
    assert "Ours differs by less than 0.01 dB inside the mask from 3DGS" in (
        verdict.verdicts(tiny)[0].headline
    )
    assert "loses 0.01 dB" in verdict.verdicts(real)[0].headline
    found = verdict.overall(tiny)
    assert found is not None
    assert "Ours differs by less than 0.01 dB from 3DGS on both captures" in found.headline


def test_one_view_alone_claims_nothing_over_captures(make_row: Callable[..., Row]) -> None:
    rows = [of_seed(0, row, 1, 0.0) for row in pair(make_row, [5.0] * 6)]
    found = verdict.overall([row | {"capture": name} for name in "abc" for row in rows])
    assert found is not None
    assert "cannot be told apart by one view from 3DGS on all 3 captures" in found.headline


def test_a_cost_that_is_not_known_is_not_called_the_same(make_row: Callable[..., Row]) -> None:
    rows = pair(make_row, [0.5] * 6)
    for row in rows:
        row["metrics"] |= {"size_mb": 0.0}
    assert verdict.verdicts(rows)[0].headline.endswith("3DGS at the same time.")
    for row in rows:
        row["metrics"] |= {"time": 0.0, "cpu_time": 0.0}
    assert verdict.verdicts(rows)[0].headline.endswith("inside the mask over 3DGS.")


@pytest.mark.parametrize(
    ("size", "words"),
    [(3.28, "an 18 % smaller"), (3.68, "an 8 % smaller"), (3.56, "an 11 % s"), (7.24, "an 81 % l")],
)
def test_articles_go_by_how_a_number_is_spoken(
    make_row: Callable[..., Row], size: float, words: str
) -> None:
    assert words in verdict.verdicts(pair(make_row, [0.5] * 6, size_mb=size))[0].headline


def test_the_first_sentence_counts_captures(make_row: Callable[..., Row]) -> None:
    better, worse = (pair(make_row, [shift] * 6, size_mb=2.0) for shift in (0.5, -0.3))
    doubtful = pair(make_row, [1.5, -0.5, 1.6, -0.5, 0.4, 0.6], size_mb=2.0)
    rows = [
        row | {"capture": name}
        for name, rows in (("a", better), ("b", worse), ("c", doubtful))
        for row in rows
    ]
    found = verdict.overall(rows)
    assert found is not None
    assert found.headline == (
        "Without backgrounds, Ours gains over 3DGS on 1 of 3 captures, loses on 1 and does not "
        "measurably differ on 1; on average +0.24 dB inside the mask, size × 0.50, time × 1.00."
    )
    assert verdict.overall(better) is None, "one capture speaks for itself"


def test_scores_of_the_object_and_of_the_frame_have_no_common_mean(
    make_row: Callable[..., Row],
) -> None:
    pairs = {name: pair(make_row, [0.5] * 6) for name in ("a", "b", "c")}
    for row in pairs["c"]:  # a capture without masks
        for view in row["per_view"]:
            view["psnr"] += 9.0 if row["method"] == "ours" else 0.0
            del view["mask_psnr"]
    rows = [row | {"capture": name} for name, both in pairs.items() for row in both]
    found = verdict.overall(rows)
    assert found is not None
    assert found.headline.startswith(
        "Without backgrounds, Ours gains over 3DGS on 2 of 3 captures and is not measured by the "
        "same score on 1; on average +0.50 dB inside the mask, "
    )


def test_what_the_background_costs_is_told_of_3dgs(make_row: Callable[..., Row]) -> None:
    kept, removed = (make_row("rover", background, "3dgs") for background in ("original", "nobg"))
    kept["metrics"] |= {"size_mb": 9.0, "time": 100.0}
    removed["metrics"] |= {"size_mb": 4.5, "time": 25.0}
    for view, base in zip(removed["per_view"], kept["per_view"], strict=True):
        view["mask_psnr"] = base["mask_psnr"] + 0.4
    (found,) = verdict.verdicts([kept, removed])
    (told,) = found.details
    start, numbers = told.split(": ")
    assert start == "Removing the background, with 3DGS"
    assert numbers == "PSNR in mask +0.40 dB; size × 0.50; time × 0.25."
    assert verdict.verdicts([removed])[0].details == ()


def of_cell(row: Row, capture: str, background: str) -> Row:
    condition = f"{background}-{row['method']}"
    return row | {"capture": capture, "background": background, "condition": condition}


def test_each_background_of_several_captures_has_a_sentence_over_them(
    make_row: Callable[..., Row],
) -> None:
    rows = [
        of_cell(row, capture, background)
        for background, gain in (("nobg", 0.5), ("original", -0.3))
        for capture in ("a", "b")
        for row in pair(make_row, [gain] * 6)
    ]
    found = verdict.overall(rows)
    assert found is not None
    without = found.headline
    assert without.startswith("Without backgrounds, Ours gains over 3DGS on both captures; on ")
    assert "on average +0.50 dB inside the mask" in without
    (others,) = found.details
    assert others.startswith("With backgrounds, Ours loses against 3DGS on both captures; on ")
    assert "on average −0.30 dB inside the mask" in others
    fewer = [row for row in rows if (row["capture"], row["background"]) != ("b", "original")]
    alone = verdict.overall(fewer)
    assert alone is not None
    assert (alone.headline, alone.details) == (without, ()), "one capture speaks for itself"


def test_every_method_is_in_the_headline_and_small_parts_are_told(
    make_row: Callable[..., Row],
) -> None:
    rows = pair(make_row, [0.5] * 6)
    more = make_row("rover", "nobg", "ours+")
    for row, gain in ((rows[0], 0.0), (rows[1], 0.5), (more, 1.0)):
        for view, base in zip(row["per_view"], rows[0]["per_view"], strict=True):
            view["detail_psnr"] = base["mask_psnr"] - 1 + gain
            view["mask_psnr"] = base["mask_psnr"] + gain
    (found,) = verdict.verdicts([*rows, more])
    assert "Ours gains 0.50 dB" in found.headline
    assert "; Ours+ gains 1.00 dB inside the mask over 3DGS" in found.headline
    assert any("Ours+ − 3DGS" in text and "small parts +1.00 dB" in text for text in found.details)


def test_without_3dgs_there_is_nothing_to_compare(make_row: Callable[..., Row]) -> None:
    (found,) = verdict.verdicts([make_row("rover", "nobg", "ours")])
    assert found.headline == "Rover: nothing to compare."


def test_the_page_says_under_what_settings_it_came_about(make_row: Callable[..., Row]) -> None:
    rows = [make_row("rover", "nobg", "ours", seed) for seed in (1, 0)]
    assert verdict.facts(rows) == {
        "Iterations": "1,000",
        "Longest side": "320 px",
        "Seeds": "0, 1",
        "CPU": "A CPU",
        "Threads per training": "1",
    }
