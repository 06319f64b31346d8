"""Exposures of photos: gradients against autograd, and what they are for."""

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from mattgs_ops.capture.scene import Scene
from mattgs_ops.config import Condition, TrainConfig
from mattgs_ops.method import METHODS
from mattgs_ops.splat.exposure import (
    RATE,
    RATE_FINAL,
    ExposureGradients,
    Exposures,
    exposure_rate,
)
from mattgs_ops.splat.files.ply import read_ply
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.photos import load_view
from mattgs_ops.splat.rasterize import Rendering
from mattgs_ops.splat.render import render_view
from mattgs_ops.splat.training.train import train

COLOUR = (0.9, 0.5, 0.1)
SHAPE = (5, 7)


def drawn(seed: int = 0) -> tuple[Exposures, Rendering]:
    """Make exposures that are no identity, and a rendering of noise."""
    generator = torch.Generator().manual_seed(seed)
    exposures = Exposures.identity(3, 100)
    exposures.matrices += 0.2 * torch.randn(3, 3, 4, generator=generator)
    image, alpha = (torch.rand(*s, generator=generator) for s in ((*SHAPE, 3), SHAPE))
    nothing = torch.zeros(0)
    return exposures, Rendering(image, alpha, nothing, nothing, Splats.zeros(0), None)


def test_gradients_are_autograds() -> None:
    exposures, rendering = drawn()
    leaves = [t.double().requires_grad_() for t in (rendering.image, rendering.alpha)]
    matrix = exposures.matrices[1].double().requires_grad_()
    colour = torch.tensor(COLOUR, dtype=torch.float64)
    # the definition, written out: what the splats show is changed, what lies behind them is not
    behind = (1 - leaves[1])[..., None] * colour
    shown = torch.einsum("ck,hwk->hwc", matrix[:, :3], leaves[0] - behind)
    shown = shown + leaves[1][..., None] * matrix[:, 3] + behind
    np.testing.assert_allclose(exposures.apply(1, rendering, COLOUR), shown.detach(), atol=1e-6)
    grad = torch.randn(*SHAPE, 3, generator=torch.Generator().manual_seed(1))
    (shown * grad).sum().backward()
    found = exposures.gradients(1, rendering, COLOUR, grad)
    for ours, leaf in zip((found.image, found.alpha, found.matrix), (*leaves, matrix), strict=True):
        assert leaf.grad is not None
        np.testing.assert_allclose(ours, leaf.grad, atol=1e-5)


def test_the_number_of_threads_changes_no_bit_of_a_gradient() -> None:
    generator = torch.Generator().manual_seed(3)
    height, width = 300, 401  # at which torch rounded dL/dalpha otherwise on two threads
    image, grad = (torch.randn(height, width, 3, generator=generator) for _ in range(2))
    alpha = torch.rand(height, width, generator=generator)
    exposures, _ = drawn()
    nothing = torch.zeros(0)
    rendering = Rendering(image, alpha, nothing, nothing, Splats.zeros(0), None)
    before, found = torch.get_num_threads(), []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            found.append(exposures.gradients(1, rendering, COLOUR, grad))
    finally:
        torch.set_num_threads(before)
    one, two = found
    assert torch.equal(one.matrix, two.matrix)
    assert torch.equal(one.image, two.image)
    assert torch.equal(one.alpha, two.alpha)


def test_the_identity_changes_nothing() -> None:
    _, rendering = drawn()
    plain = Exposures.identity(2, 100)
    np.testing.assert_allclose(plain.apply(0, rendering, COLOUR), rendering.image, atol=1e-6)
    grad = torch.ones(*SHAPE, 3)
    found = plain.gradients(0, rendering, COLOUR, grad)
    np.testing.assert_array_equal(found.image, grad)
    np.testing.assert_allclose(found.alpha, 0, atol=1e-6)
    assert plain.spread() == pytest.approx(1)


def test_a_background_stays_what_it_is() -> None:
    exposures, _ = drawn()
    white = Rendering(
        torch.ones(*SHAPE, 3),
        torch.zeros(*SHAPE),
        torch.zeros(0),
        torch.zeros(0),
        Splats.zeros(0),
        None,
    )
    np.testing.assert_allclose(exposures.apply(0, white, (1.0, 1.0, 1.0)), 1, atol=1e-6)


def test_the_mean_of_all_matrices_stays_the_identity() -> None:
    exposures, rendering = drawn()
    exposures.matrices = Exposures.identity(3, 100).matrices
    for step in range(20):
        grad = torch.full((*SHAPE, 3), 1.0)
        exposures.descend(step % 2, rendering, COLOUR, grad, step)
        np.testing.assert_allclose(exposures.matrices.mean(dim=0), torch.eye(3, 4), atol=1e-6)
    assert exposures.steps.tolist() == [10, 10, 0]
    assert exposures.spread() > 1.1


def test_gradients_of_alpha_add_up() -> None:
    one = torch.ones(*SHAPE)
    found = ExposureGradients(one, one, one)
    assert found.with_alpha(None) is one
    assert found.with_alpha(one).tolist() == (2 * one).tolist()


def test_the_rate_falls_from_the_first_to_the_last_step() -> None:
    assert exposure_rate(0, 100) == RATE
    assert exposure_rate(100, 100) == pytest.approx(RATE_FINAL)
    assert exposure_rate(50, 100) == pytest.approx((RATE * RATE_FINAL) ** 0.5)


def darken(scene: Scene) -> None:
    """Make every second training photo half as bright, the others and test photos as they are."""
    for view in scene.registered("train")[::2]:
        photo = cv2.imread(str(view.photo))
        assert photo is not None
        cv2.imwrite(str(view.photo), (photo * 0.5).astype(np.uint8))


def residual(scene: Scene, folder: Path) -> float:
    """Return how much test renderings differ from the photos once a common gain is taken out."""
    splats = read_ply(folder / "splats.ply")
    errors = []
    for view in scene.registered("test"):
        truth = load_view(view, "nobg", 48)
        rendered = render_view(splats, truth.camera, (1.0, 1.0, 1.0)).astype(np.float64) / 255
        inside = truth.mask > 0.9
        a, b = rendered[inside].ravel(), truth.image[inside].ravel().astype(np.float64)
        errors.append(np.abs(b - a * (a @ b) / (a @ a)).mean())
    return float(np.mean(errors))


def test_photos_of_two_exposures_are_told_apart(tiny_scene: Scene, tmp_path: Path) -> None:
    darken(tiny_scene)
    for mode in ("affine", "off"):
        config = TrainConfig(exposure=mode)
        options: dict[str, Any] = {"iterations": 300, "resolution": 48, "seed": 0}
        condition, method = Condition.parse("nobg-3dgs"), METHODS["3dgs"]
        train(tiny_scene, condition, method, config, out=tmp_path / mode, **options)
    assert not (tmp_path / "off" / "exposures.json").exists()
    found = json.loads((tmp_path / "affine" / "exposures.json").read_text())
    names = [view.name for view in tiny_scene.registered("train")]
    grey = {n: np.array(m)[:, :3].sum(axis=1).mean() * 0.5 for n, m in found["photos"].items()}
    dark, bright = [grey[n] for n in names[::2]], [grey[n] for n in names[1::2]]
    assert max(dark) < min(bright)
    assert found["spread"] > 1.5  # it was 2; a few hundred steps find most of it
    assert residual(tiny_scene, tmp_path / "affine") < residual(tiny_scene, tmp_path / "off")


def test_a_training_tells_of_its_photos_as_it_saw_them(tiny_scene: Scene, tmp_path: Path) -> None:
    """The curve's fixed view and the loss terms are with the photos' exposures, as steps were."""
    darken(tiny_scene)
    method, config = METHODS["3dgs"], TrainConfig(exposure="affine")
    options: dict[str, Any] = {"iterations": 300, "resolution": 48, "seed": 0}
    condition = Condition.parse("original-3dgs")
    report = train(tiny_scene, condition, method, config, out=tmp_path, **options)
    with (tmp_path / "curve.csv").open(encoding="utf-8") as file:
        rows = [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(file)]
    late = rows[-len(rows) // 3 :]
    seen = {name: float(np.mean([row[name] for row in late])) for name in ("loss", "psnr")}
    assert report.loss_terms["optimised_loss"] < seen["loss"]  # later than these steps
    assert rows[-1]["fixed_psnr"] > seen["psnr"] - 2  # one view against the mean of views
