"""Train U²-Net: ``train(config, out)``; deterministic with its seed, killed and resumed at will.

Written to ``out``: ``checkpoint.pt`` (everything to go on from), ``u2netp.pth`` (the averaged
weights, in the public release's form), ``curve.csv`` (step, losses, validation scores) and
``training.json``. A finished training is not done twice: it is resumed after its last step.
"""

import json
import math
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from mattgs_ops.capture.masks import quality, threshold
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.network.ahead import batches_ahead
from mattgs_ops.segment.network.batches import Batches
from mattgs_ops.segment.network.losses import segmentation_loss
from mattgs_ops.segment.network.preprocess import network_input, network_inputs
from mattgs_ops.segment.network.train_config import SegmentTrainConfig, StageConfig
from mattgs_ops.segment.network.u2net import U2Net, load_weights
from mattgs_ops.segment.training_images.composites import Image
from mattgs_ops.segment.training_images.traced.places import render_places
from mattgs_ops.segment.training_state import (
    follow,
    keep_rows,
    log_row,
    read_checkpoint,
    save_checkpoint,
)

WARMUP = 50  # steps over which the rate of a leg rises from a tenth
GRADIENT_LIMIT = 10.0  # norm; a guard against rare explosions early on, seldom active
CURVE_FIELDS = ("step", "train_loss", "val_loss", "iou", "f_measure", "mae", "boundary_f")
OnMetrics = Callable[[int, dict[str, float]], None]


@dataclass(frozen=True)
class SegmentTrainReport:
    """What a training yields; ``scores`` are the validation's at the last step."""

    weights: Path
    steps: int
    wall_seconds: float
    scores: dict[str, float]


def train(
    config: SegmentTrainConfig,
    out: Path,
    *,
    on_metrics: OnMetrics | None = None,
    progress: Progress = no_progress,
) -> SegmentTrainReport:
    """Train to the last step of the last leg, from ``out/checkpoint.pt`` where it exists.

    Raises :class:`InputError` for bad data or a checkpoint of another configuration and
    :class:`StageError` when the loss stops being a number.
    """
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(config.threads)
    cv2.setNumThreads(1)  # not beside torch's threads on a shared machine
    torch.manual_seed(config.seed)
    run = _Run(config, out)  # before what takes long: it refuses weights and checkpoints
    run.resume()
    if config.rendered:
        render_places(config.rendered, out / "rendered", progress=progress)
    batches = Batches(config, out / "rendered")
    keep_rows(out / "curve.csv", CURVE_FIELDS, run.step)
    began, before = time.perf_counter(), run.seconds
    scores: dict[str, float] = {}
    for images, masks in batches_ahead(batches, out / "rendered", run.step):
        loss = run.advance(images, masks)
        run.seconds = before + time.perf_counter() - began
        last = run.step == config.steps
        if run.step % config.validate_every == 0 or last:
            scores = run.validate(batches)
            row = {"step": run.step, "train_loss": loss, **scores}
            log_row(out / "curve.csv", CURVE_FIELDS, row)
            if on_metrics:
                on_metrics(run.step, {"train_loss": loss, **scores})
        if run.step % config.checkpoint_every == 0 or last:
            run.save()
        progress(run.step, config.steps, f"loss {loss:.3f}")
    scores = scores or run.validate(batches)
    weights = out / f"{config.variant}.pth"
    torch.save(run.average.state_dict(), weights)
    report = SegmentTrainReport(weights, run.step, run.seconds, scores)
    document = {**asdict(report), "weights": weights.name, "config": config.model_dump(mode="json")}
    (out / "training.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return report


class _Run:
    """A training under way: the network, its moving average, the optimiser, the step."""

    def __init__(self, config: SegmentTrainConfig, out: Path) -> None:
        cuda = torch.cuda.is_available() and config.device != "cpu"
        if config.device == "cuda" and not cuda:
            raise InputError("device: expected a CUDA device as asked for, found none")
        self.config, self.path = config, out / "checkpoint.pt"
        self.device = torch.device("cuda" if cuda else "cpu")
        self.model = U2Net(config.variant)
        if config.start_from:
            load_weights(self.model, config.start_from)
        self.model.to(self.device).train()
        self.average = deepcopy(self.model).eval()
        self.optimiser = torch.optim.Adam(self.model.parameters(), lr=config.stages[0].lr)
        self.step, self.seconds = 0, 0.0

    def resume(self) -> None:
        state = read_checkpoint(self.path, identity_of(self.config), self.device)
        if state is None:
            return
        self.model.load_state_dict(state["model"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.seconds = int(state["step"]), float(state["seconds"])

    def save(self) -> None:
        state = {
            "identity": identity_of(self.config),
            "step": self.step,
            "seconds": self.seconds,
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        save_checkpoint(self.path, state)

    def advance(self, images: Image, masks: Image) -> float:
        """Take one step of Adam on images [B, S, S, 3] and masks [B, S, S]; returns the loss."""
        x = network_inputs(torch.from_numpy(images).to(self.device))
        y = torch.from_numpy(masks).to(self.device)[:, None].float() / 255
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.config.stages, self.step)
        loss = segmentation_loss(self._logits(x), y, self.config.loss)
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), GRADIENT_LIMIT)
        self.optimiser.step()
        self.step += 1
        follow(self.average, self.model, self.config.average, self.step)
        value = float(loss.item())  # the step's only wait for the device
        if not math.isfinite(value):
            raise StageError(f"segmenter training: the loss is {value} at step {self.step - 1}")
        return value

    def _logits(self, x: Tensor) -> tuple[Tensor, ...]:
        """Run the network in the asked-for precision; the seven outputs come back as float32.

        Channels last is the layout that convolutions on a CPU are fastest in.
        """
        reduced = self.config.precision == "bfloat16"
        with torch.autocast(self.device.type, torch.bfloat16, enabled=reduced):
            logits: tuple[Tensor, ...] = self.model(x.contiguous(memory_format=torch.channels_last))
        return tuple(output.float() for output in logits)

    @torch.no_grad()
    def validate(self, batches: Batches) -> dict[str, float]:
        """Score the averaged network on the validation composites, at the largest leg's size."""
        size = max(stage.size for stage in self.config.stages)
        rows = [self._score(image, mask) for image, mask in batches.validation(size)]
        return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}

    def _score(self, image: Image, mask: Image) -> dict[str, float]:
        size = image.shape[0]
        x = torch.from_numpy(network_input(image, size, size))[None].to(self.device)
        logits: tuple[Tensor, ...] = self.average(x)
        truth = torch.from_numpy(mask.astype(np.float32) / 255)[None, None].to(self.device)
        loss = segmentation_loss(logits, truth, self.config.loss)
        soft = logits[0][0, 0].sigmoid().cpu().numpy()
        scored = quality(threshold(soft), mask, soft)
        return {"val_loss": float(loss.item()), **scored.as_dict()}


def identity_of(config: SegmentTrainConfig) -> str:
    """Return everything of a configuration that changes the weights, as text."""
    passive = {
        "threads",
        "device",
        "checkpoint_every",
        "validate_every",
        "validation_images",
    }
    if config.reuse == 1 or config.workers <= 1:  # several lanes show other composites again
        passive.add("workers")
    return config.model_dump_json(exclude=passive)


def learning_rate(stages: tuple[StageConfig, ...], step: int) -> float:
    """Half a cosine from a leg's ``lr`` to its ``lr_end``, after a short rise."""
    for stage in stages:
        if step < stage.steps:
            break
        step -= stage.steps
    blend = 0.5 * (1 + math.cos(math.pi * min(1.0, step / stage.steps)))
    rate = stage.lr_end + (stage.lr - stage.lr_end) * blend
    rise = min(WARMUP, max(1, stage.steps // 10))
    return rate * min(1.0, 0.1 + 0.9 * step / rise)
