"""The training losses against values by hand."""

import math

import pytest
import torch

from mattgs_ops.segment.network.losses import dice_loss, segmentation_loss


def test_bce_is_summed_over_all_outputs() -> None:
    logits = [torch.zeros(2, 1, 4, 4)] * 7
    truth = torch.ones(2, 1, 4, 4)
    assert float(segmentation_loss(logits, truth)) == pytest.approx(7 * math.log(2), rel=1e-6)


def test_dice_by_hand() -> None:
    truth = torch.zeros(1, 1, 2, 2)
    truth[..., 0, :] = 1  # two pixels, of which one is found, and one more wrongly
    found = torch.tensor([[[[1.0, 0.0], [1.0, 0.0]]]])
    assert float(dice_loss(found, truth)) == pytest.approx(1 - (2 * 1 + 1) / (4 + 1))


def test_dice_is_added_and_vanishes_for_a_perfect_map() -> None:
    truth = (torch.arange(16.0).reshape(1, 1, 4, 4) > 7).float()
    sure = [(truth * 2 - 1) * 50] * 7
    assert float(segmentation_loss(sure, truth, "bce_dice")) == pytest.approx(0, abs=1e-5)
    unsure = [torch.zeros(1, 1, 4, 4)] * 7
    plain, both = (float(segmentation_loss(unsure, truth, k)) for k in ("bce", "bce_dice"))
    dice = 1 - (2 * 4 + 1) / (8 + 8 + 1)
    assert both - plain == pytest.approx(7 * dice, rel=1e-5)
