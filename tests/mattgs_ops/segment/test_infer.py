"""Inference: every source of masks, what is written, and every bad input by name."""

import warnings
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from mattgs_ops.capture.masks import map_folders, quality
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import SegmentConfig
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.segment.infer import segment
from mattgs_ops.segment.mask_report import MaskReport, flags_of
from mattgs_ops.segment.network.preprocess import IMAGENET_DEVIATION, IMAGENET_MEAN, network_input
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork, stretched

WIDTH, HEIGHT = 96, 72
MasksAre = Literal["alpha", "given", "truth", "none"]


class Redness(nn.Module):
    """A network that finds red things: saliency is how much red exceeds blue."""

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        found = torch.sigmoid(2 * (image[:, :1] - image[:, 2:]))
        return found, image


def exported(
    module: nn.Module,
    path: Path,
    shape: tuple[int, ...],
    *,
    batch: bool = True,
    outputs: list[str] | None = None,
) -> Path:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        torch.onnx.export(
            module,
            (torch.zeros(*shape),),
            str(path),
            dynamo=False,
            input_names=["photo"],
            output_names=outputs,
            dynamic_axes={"photo": {0: "n"}} if batch else None,
        )
    return path


@pytest.fixture(scope="module")
def redness(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(Redness(), tmp_path_factory.mktemp("onnx") / "red.onnx", (1, 3, 40, 48))


def capture(folder: Path, masks_are: MasksAre = "truth", views: int = 3) -> PreparedCapture:
    """Red discs on a blue-green ground, with their masks."""
    rows = []
    for i in range(views):
        photo, mask_path = folder / f"v{i}.jpg.png", folder / "m" / f"v{i}.jpg.png"
        mask_path.parent.mkdir(parents=True, exist_ok=True)
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        cv2.circle(mask, (40 + 6 * i, 36), 20, 255, -1)
        image = np.full((HEIGHT, WIDTH, 3), (90, 110, 40), np.uint8)  # BGR
        image[mask > 0] = (20, 30, 220)
        cv2.imwrite(str(photo), image)
        cv2.imwrite(str(mask_path), mask)
        given = mask_path if masks_are != "none" else None
        rows.append(View(f"v{i}.jpg", "train", WIDTH, HEIGHT, photo, given, None))
    return PreparedCapture("discs", folder, tuple(rows), masks_are, "none")


def masks_in(folder: Path) -> dict[str, np.ndarray]:
    return {
        p.name: np.asarray(cv2.imread(str(p), cv2.IMREAD_UNCHANGED))
        for p in sorted(folder.iterdir())
    }


def test_a_network_cuts_every_photo_out(tmp_path: Path, redness: Path) -> None:
    source = capture(tmp_path / "in")
    report = segment(source, SegmentConfig(model=redness), tmp_path / "out")
    masks, soft = masks_in(tmp_path / "out/masks"), masks_in(tmp_path / "out/soft")
    assert list(masks) == list(soft) == ["v0.jpg.png", "v1.jpg.png", "v2.jpg.png"]
    for mask in masks.values():
        assert mask.shape == (HEIGHT, WIDTH)
        assert set(np.unique(mask)) == {0, 255}
    assert report.source == "u2net"
    assert report.mean_iou is not None
    assert report.mean_iou > 0.95
    assert report.means()["worst_iou"] > 0.94
    assert report.views[0].foreground == pytest.approx((masks["v0.jpg.png"] > 0).mean())
    assert not report.flagged
    assert MaskReport.load(tmp_path / "out/masks.json") == report


class TwoOpinions(nn.Module):
    """Says red things by a first output that is the mean of two further ones."""

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        red = torch.sigmoid(2 * (image[:, :1] - image[:, 2:]))
        return (red + 1 - red.flip(3)) / 2, red, 1 - red.flip(3)


def test_what_each_network_of_a_file_says_is_kept_below_soft(tmp_path: Path) -> None:
    names = ["saliency", "saliency/1", "saliency/2"]
    model = exported(TwoOpinions(), tmp_path / "two.onnx", (1, 3, 36, 48), outputs=names)
    segment(capture(tmp_path / "in"), SegmentConfig(model=model), tmp_path / "out")
    soft = tmp_path / "out" / "soft"
    assert map_folders(soft) == [soft, soft / "1", soft / "2"]
    one, two = (masks_in(soft / name)["v0.jpg.png"].astype(int) for name in ("1", "2"))
    assert one[36, 40] > 250 > 5 > one[5, 5]
    np.testing.assert_allclose(two, 255 - one[:, ::-1], atol=2)


def test_one_photo_with_nothing_in_it_gets_a_black_mask_and_a_flag(
    tmp_path: Path, redness: Path
) -> None:
    source = capture(tmp_path / "in", "none")
    cv2.imwrite(str(source.views[1].photo), np.full((HEIGHT, WIDTH, 3), (90, 110, 40), np.uint8))
    report = segment(source, SegmentConfig(model=redness), tmp_path / "out")
    masks = masks_in(tmp_path / "out/masks")
    assert [bool(mask.any()) for mask in masks.values()] == [True, False, True]
    assert "empty" in report.views[1].flags
    assert "empty" not in report.views[0].flags


def test_fixed_batches_are_filled_up(tmp_path: Path) -> None:
    model = exported(Redness(), tmp_path / "two.onnx", (2, 3, 32, 32), batch=False)
    source = capture(tmp_path / "in")
    report = segment(source, SegmentConfig(model=model), tmp_path / "out")
    assert report.mean_iou is not None
    assert report.mean_iou > 0.9


@pytest.mark.parametrize("refine", ["none", "grabcut"])
def test_grabcut_alone_and_as_refinement(tmp_path: Path, redness: Path, refine: str) -> None:
    source = capture(tmp_path / "in", views=1)
    alone = SegmentConfig(source="grabcut")
    seeded = SegmentConfig(model=redness, refine=refine)
    for i, settings in enumerate((alone, seeded)):
        report = segment(source, settings, tmp_path / f"out{i}")
        assert report.mean_iou is not None
        assert report.mean_iou > 0.95


@pytest.mark.parametrize("masks_are", ["given", "alpha"])
def test_masks_that_came_along_are_used_as_they_are(tmp_path: Path, masks_are: MasksAre) -> None:
    source = capture(tmp_path / "in", masks_are)
    report = segment(source, SegmentConfig(), tmp_path / "out")
    assert (report.source, report.model, report.mean_iou) == ("given", None, None)
    for view, mask in zip(source.views, masks_in(tmp_path / "out/masks").values(), strict=True):
        given = np.asarray(cv2.imread(str(view.mask), cv2.IMREAD_UNCHANGED))
        assert np.array_equal(mask, given)


def test_true_masks_are_used_only_when_asked_for(tmp_path: Path, redness: Path) -> None:
    source = capture(tmp_path / "in")
    assert segment(source, SegmentConfig(model=redness), tmp_path / "a").source == "u2net"
    given = segment(source, SegmentConfig(source="given"), tmp_path / "b")
    assert given.mean_iou == 1


def test_no_segmentation_takes_everything(tmp_path: Path) -> None:
    report = segment(capture(tmp_path / "in"), SegmentConfig(source="none"), tmp_path / "out")
    assert [view.foreground for view in report.views] == [1, 1, 1]
    assert not report.flagged


def test_bad_given_masks_are_named(tmp_path: Path) -> None:
    def problem(change, message: str) -> None:  # type: ignore[no-untyped-def]
        source = capture(tmp_path / "in", "given")
        change(source)
        with pytest.raises(InputError, match=message):
            segment(source, SegmentConfig(), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def write(pixels: np.ndarray, count: int = 1):  # type: ignore[no-untyped-def]
        def change(source: PreparedCapture) -> None:
            for view in source.views[-count:]:
                cv2.imwrite(str(view.mask), pixels)

        return change

    small = np.zeros((36, 48), np.uint8)
    small[10:20, 10:20] = 255
    inverted = np.full((HEIGHT, WIDTH), 255, np.uint8)
    inverted[20:50, 30:70] = 0
    problem(write(small), r"v2\.jpg\.png.*48.36.*96.72")
    problem(write(np.zeros((HEIGHT, WIDTH), np.uint8)), r"v2\.jpg\.png.*empty")
    problem(write(np.full((HEIGHT, WIDTH), 255, np.uint8)), r"v2\.jpg\.png.*white all over")
    problem(write(inverted, 3), "inverted")
    problem(lambda s: s.views[1].mask.write_bytes(b"no mask"), r"v1\.jpg\.png")
    with pytest.raises(InputError, match=r"discs.*given.*found none"):
        segment(capture(tmp_path / "x", "none"), SegmentConfig(source="given"), tmp_path / "out")


class Flat(nn.Module):
    def forward(self, image: Tensor) -> Tensor:
        return image[:, :1] * 0 + 0.3


class Wide(nn.Module):
    def forward(self, image: Tensor) -> Tensor:
        return torch.cat([image, image], 1)


class Grey(nn.Module):
    def forward(self, image: Tensor) -> Tensor:
        return image.mean(1, keepdim=True)


def test_nothing_found_anywhere_ends_the_capture(tmp_path: Path) -> None:
    model = exported(Flat(), tmp_path / "flat.onnx", (1, 3, 32, 32))
    with pytest.raises(StageError, match="discs: no object was found in any of 3 photos"):
        segment(capture(tmp_path / "in"), SegmentConfig(model=model), tmp_path / "out")
    with pytest.raises(StageError, match=r"a\.jpg: .*nan"):
        stretched(np.full((2, 2), np.nan, np.float32), 4, 4, "a.jpg")


def test_files_that_are_no_saliency_network_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no model")
    wide = exported(Wide(), tmp_path / "wide.onnx", (1, 3, 16, 16))
    grey = exported(Grey(), tmp_path / "grey.onnx", (1, 1, 16, 16))
    for path, message in (
        (tmp_path / "none.onnx", "none.onnx: expected a segmentation model .* no such file"),
        (broken, "broken.onnx: expected a segmentation model"),
        (wide, r"wide.onnx: expected a first output \[N, 1, H, W\], found .*6"),
        (grey, r"grey.onnx: expected one float32 input \[N, 3, H, W\], found photo"),
    ):
        with pytest.raises(InputError, match=message):
            SaliencyNetwork(path)


def test_the_input_is_the_reference_implementations() -> None:
    photo = np.zeros((4, 4, 3), np.uint8)
    photo[..., 0] = 200  # the photo's maximum, which becomes 1
    photo[..., 1] = 50
    found = network_input(photo, 4, 4)
    expected = (np.array([1, 0.25, 0]) - IMAGENET_MEAN) / IMAGENET_DEVIATION
    assert found.shape == (3, 4, 4)
    assert found[:, 2, 2] == pytest.approx(expected, rel=1e-5)
    black = network_input(np.zeros((4, 4, 3), np.uint8), 2, 2)
    assert np.isfinite(black).all()


def test_maps_are_stretched_and_resized() -> None:
    raw = np.array([[0.2, 0.6], [0.2, 0.6]], np.float32)
    soft = stretched(raw, 8, 6, "a.jpg")
    assert soft.shape == (6, 8)
    assert soft.min() == 0
    assert soft.max() == 1


def test_flags() -> None:
    shares = [0.2, 0.21, 0.001, 0.2, 0.19, 0.5, 0.2, 0.99]
    frames = [0.0] * 6 + [0.4, 1.0]
    flags = flags_of(shares, frames)
    assert flags[2] == ("empty", "outlier")
    assert flags[5] == ("outlier",)
    assert flags[6] == ("frame",)
    assert flags[7] == ("full", "outlier", "frame")
    assert flags[0] == flags[1] == ()
    assert flags_of([0.3], [0.0]) == [()]


@pytest.mark.skipif(not BUNDLED_MODEL.is_file(), reason="built without the trained model")
def test_the_bundled_model_finds_a_thing_on_a_desk() -> None:
    from mattgs_ops.segment.training_images.composites import Composites
    from mattgs_ops.segment.training_images.textures import Bank

    source, scores = Composites(99, 192, Bank(99, per_maker=1)), []
    network = SaliencyNetwork(BUNDLED_MODEL)
    for index in range(5):
        image, mask = source.sample(index)
        (soft,) = network.soft_maps([image], ["a"])
        scores.append(quality(np.where(soft > 0.5, 255, 0).astype(np.uint8), mask).iou)
    assert BUNDLED_MODEL.stat().st_size < 8e6
    assert np.median(scores) > 0.5
