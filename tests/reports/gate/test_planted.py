"""The gate on the project's own baseline: losses planted into it are named, nothing else is."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from reports.gate import baseline, planted
from reports.gate.compare import compare
from reports.gate.findings import ALL_CELLS, Exit, Verdict
from reports.gate.planted import grow, lose_quality, lose_speed
from reports.gate.tolerances import TOLERANCES, Doubt
from reports.rows.schema import Row, held_out_views

Change = Callable[[Row], Row]


@pytest.fixture(scope="module")
def known() -> baseline.Baseline:
    """Return the committed baseline, with its noise between machines; nobody changes its rows."""
    found = baseline.load("quick-ci")
    assert found.noise["psnr"] > 0.05, "else there is nothing that could hide a loss"
    return found


def elsewhere(rows: Sequence[Row]) -> list[Row]:
    """Return the same rows as if another kind of processor had made them."""
    return [row | {"provenance": row["provenance"] | {"cpu_kind": "another"}} for row in rows]


def worse(rows: Sequence[Row], known: baseline.Baseline) -> set[str]:
    report = compare(rows, known.rows, noise=known.noise, doubt=Doubt.NONE)
    return {f.metric for f in report.findings if f.verdict == Verdict.WORSE}


def test_the_committed_baseline_shows_every_planted_loss(known: baseline.Baseline) -> None:
    seen = planted.sensitivity(known.rows, known.noise)
    assert seen.complete, str(seen)
    assert {"0.3 dB everywhere", "0.5 dB in ours+", "10% larger files"} <= set(seen.named)
    assert {"a view leaked into training", "masks 2 px larger", "another truth"} <= set(seen.named)


@pytest.mark.parametrize("seed", range(5))
def test_noise_between_machines_hides_no_loss_on_one(known: baseline.Baseline, seed: int) -> None:
    """The views that lose most are others each time; the mean loss is 0.3 dB each time."""
    names = [str(view["view"]) for view in held_out_views(known.rows[0])]
    order = np.random.default_rng(seed).permutation(len(names))
    drawn = dict(zip(names, 0.3 * planted._pattern("any", len(names), 0.5)[order], strict=True))

    def lose(row: Row) -> Row:
        out: Row = json.loads(json.dumps(row))
        for view in held_out_views(out):
            for metric in ("psnr", "mask_psnr"):
                view[metric] -= drawn[str(view["view"])]  # type: ignore[index]
        return out

    assert {"psnr", "mask_psnr"} <= worse([lose(row) for row in known.rows], known)


def test_a_loss_in_one_method_is_named(known: baseline.Baseline) -> None:
    rows = [lose_quality(r, 0.7) if r["method"] == "ours+" else r for r in known.rows]
    assert {"psnr", "mask_psnr"} <= worse(rows, known)


@pytest.mark.parametrize("seed", range(10))
def test_other_rounding_is_no_loss(known: baseline.Baseline, seed: int) -> None:
    """Every run moves by itself, as it does when code rounds otherwise, here or elsewhere."""
    rng, noise = np.random.default_rng(seed), known.noise["psnr"] * np.sqrt(2)
    moved = [lose_quality(row, rng.normal(0, noise)) for row in known.rows]
    for rows in (moved, elsewhere(moved)):
        assert not worse(rows, known)
        seen = compare(rows, known.rows, noise=known.noise).smallest_named()
        assert 0.1 < seen["psnr"] < 0.25, "other rounding costs sight, but not that of 0.3 dB"
    assert compare(known.rows, known.rows).smallest_named()["psnr"] == pytest.approx(0.1)


def test_a_gate_that_is_blind_is_noticed(
    known: baseline.Baseline, monkeypatch: pytest.MonkeyPatch
) -> None:
    wide = tuple(replace(one, margin=10.0) for one in TOLERANCES)
    monkeypatch.setattr("reports.gate.compare.TOLERANCES", wide)
    seen = planted.sensitivity(known.rows, known.noise)
    assert not seen.complete
    assert "0.3 dB everywhere" in seen.missed
    assert "not named: 0.3 dB everywhere" in str(seen)


@pytest.mark.parametrize(
    ("plant", "metrics"),
    [(lose_quality, {"psnr", "mask_psnr"}), (grow, {"size_mb", "splats"}), (lose_speed, {"fps"})],
)
def test_a_plant_changes_what_it_says(
    known: baseline.Baseline, plant: Change, metrics: set[str]
) -> None:
    assert metrics <= worse([plant(row) for row in known.rows], known)


def test_a_planted_loss_is_uneven_and_keeps_its_mean(known: baseline.Baseline) -> None:
    row = known.rows[0]
    before, after = held_out_views(row), held_out_views(lose_quality(row, 0.3))
    lost = np.array([a["psnr"] - b["psnr"] for a, b in zip(before, after, strict=True)])
    assert lost.mean() == pytest.approx(0.3)
    assert 0.05 < lost.std() < 0.4
    assert (lost > 0).all()


def two_captures(known: baseline.Baseline) -> list[Row]:
    """Return the rows of the one capture twice, under two names."""
    return [row | {"capture": name} for name in ("one", "two") for row in known.rows]


def test_a_loss_everywhere_is_uneven_among_captures(known: baseline.Baseline) -> None:
    rows = two_captures(known)
    shares = []
    for draw in range(20):
        lost = planted.lose_everywhere(rows, 0.3, draw)
        means = [
            np.mean(
                [a["psnr"] - b["psnr"] for a, b in zip(*map(held_out_views, pair), strict=True)]
            )
            for pair in zip(rows, lost, strict=True)
        ]
        assert np.mean(means) == pytest.approx(0.3)
        shares.append(means[0] / 0.3)
    assert 0.2 < np.std(shares) < 0.6, "captures lose different amounts"


def test_a_loss_in_one_capture_is_planted_and_named(known: baseline.Baseline) -> None:
    seen = planted.sensitivity(two_captures(known), known.noise)
    assert {"0.3 dB everywhere", "0.5 dB in one", "0.5 dB in two"} <= set(seen.named), str(seen)


def test_a_metric_of_zero_is_no_crash(known: baseline.Baseline) -> None:
    rows: list[dict[str, Any]] = json.loads(json.dumps(list(known.rows)))
    rows[0]["metrics"]["splats"] = 0
    report = compare(rows, known.rows, noise=known.noise)
    (finding,) = [f for f in report.findings if f.verdict == Verdict.NOT_COMPARABLE]
    assert finding.metric == "splats"
    assert finding.reason == "the candidate has 0: expected more than 0"
    assert report.exit_code == Exit.CANNOT_JUDGE


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (("truth", "prepare"), "the truth changed in the stage prepare"),
        (("truth",), "the truth changed in the stage evaluate"),
        (("masks", "truth", "agree"), "the masks changed in the stage agree"),
        (("masks", "segment", "agree"), "the masks changed in the stage segment"),
        (("split", "prepare"), "the split changed in the stage prepare"),
    ],
)
def test_a_changed_truth_names_the_stage_and_is_not_comparable(
    known: baseline.Baseline, changed: Sequence[str], told: str
) -> None:
    row = known.rows[0]
    rows = [row | {"digests": row["digests"] | dict.fromkeys(changed, "new")}, *known.rows[1:]]
    report = compare(rows, known.rows, noise=known.noise)
    (finding,) = [f for f in report.findings if f.verdict == Verdict.NOT_COMPARABLE]
    assert told in finding.reason
    assert report.exit_code == Exit.CANNOT_JUDGE


def test_stages_that_change_nothing_of_the_truth_block_nothing(known: baseline.Baseline) -> None:
    rows = [row | {"digests": row["digests"] | {"segment": "new"}} for row in known.rows]
    assert compare(rows, known.rows).exit_code == Exit.PASS


def test_rows_without_digests_are_never_the_same(known: baseline.Baseline) -> None:
    old = [{k: v for k, v in row.items() if k != "digests"} for row in known.rows]
    for new, before in ((old, known.rows), (known.rows, old), (old, old)):
        report = compare(new, before)
        assert report.exit_code == Exit.CANNOT_JUDGE
        assert "does not state its digest" in report.findings[0].reason


def test_masks_that_moved_are_still_judged_by_their_iou(known: baseline.Baseline) -> None:
    before = [row | {"masks": row["masks"] | {"mean_iou": 0.95}} for row in known.rows]
    after = [
        planted.other_masks(row | {"masks": row["masks"] | {"mean_iou": 0.91}}) for row in before
    ]
    report = compare(after, before)
    assert {f.metric for f in report.findings if f.verdict == Verdict.WORSE} == {"mean_iou"}
    assert report.exit_code == Exit.REGRESSION


def test_nothing_conclusive_is_nothing_judged(known: baseline.Baseline) -> None:
    """Scores that jump both ways by more than a gate can bear: doubt everywhere, and no pass."""
    rng = np.random.default_rng(0)
    rows: list[dict[str, Any]] = json.loads(json.dumps(list(known.rows)))
    plain = ("psnr", "mask_psnr", "ssim", "mask_ssim", "l1", "mask_l1", "paper_l1")
    scores = (*plain, "detail_psnr", "detail_ssim")
    for row in rows:
        for view in held_out_views(row):
            for metric in scores:
                if view.get(metric) is not None:  # small parts are known in some views
                    view[metric] *= rng.uniform(0.5, 1.5)  # type: ignore[index]
    report = compare(rows, known.rows, doubt=Doubt.NONE)
    assert not any(f.verdict == Verdict.WORSE for f in report.findings)
    assert report.exit_code == Exit.CANNOT_JUDGE


def test_lost_views_are_exact_here_and_have_a_noise_between_machines(
    known: baseline.Baseline,
) -> None:
    def without(rows: Sequence[Row], views: int) -> list[Row]:
        found = [dict(row["registration"]) for row in rows]
        left = [one | {"registered": one["registered"] - views} for one in found]
        return [row | {"registration": one} for row, one in zip(rows, left, strict=True)]

    assert "registered" in worse(without(known.rows, 1), known)
    bare = baseline.Baseline("bare", known.rows)  # nobody measured noise
    assert "registered" not in worse(elsewhere(without(known.rows, 1)), bare)
    assert "registered" in worse(elsewhere(without(known.rows, 24)), bare)


def test_all_cells_means_all_cells() -> None:
    assert "@" not in ALL_CELLS, "by which planted losses tell single cells apart"
