"""Train the outline's network: ``train(config, out)``; killed and resumed at will.

Written to ``out``: the images of ``images``, ``checkpoint.pt`` (everything to go on from),
``outline.pth`` (the averaged weights), ``outline.onnx`` and ``curve.csv``: losses, and the pixels
that are wrong in coarse maps and in the network's, as shares of the object in a crop, medians over
held-out crops.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.progress import Progress, no_progress
from mattgs_ops.segment.onnx_files.onnx_file import write_model
from mattgs_ops.segment.outline.crops import Drawn, Pair, batch, load_pairs
from mattgs_ops.segment.outline.images import draw_images
from mattgs_ops.segment.outline.network import MULTIPLE, OutlineNet
from mattgs_ops.segment.outline.train_config import OutlineTrainConfig
from mattgs_ops.segment.training_state import (
    follow,
    keep_rows,
    load_weights,
    log_row,
    read_checkpoint,
    save_checkpoint,
)

WARMUP = 100  # steps over which the rate rises
RATE_LEFT = 0.01  # of the rate, at the end
VALIDATION_BATCHES = 8
VALIDATION_SEED_SHIFT = 1_000_003  # keeps validation's crops apart from training's
CURVE_FIELDS = ("step", "train_loss", "val_loss", "wrong_before", "wrong_after")
NAMES = ("photo_and_map", "object")  # of the ONNX file's input and output
OnMetrics = Callable[[int, dict[str, float]], None]


def train(
    config: OutlineTrainConfig,
    out: Path,
    *,
    on_metrics: OnMetrics | None = None,
    progress: Progress = no_progress,
) -> Path:
    """Train to the last step, from ``out/checkpoint.pt`` where it exists; returns the ONNX file.

    Raises :class:`InputError` for weights, images or a checkpoint of another configuration and
    :class:`StageError` when the loss stops being a number.
    """
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(config.threads)
    cv2.setNumThreads(1)  # not beside torch's threads on a shared machine
    torch.manual_seed(config.seed)
    run = _Run(config, out / "checkpoint.pt")  # before what takes long: it refuses files
    folders = draw_images(config, out, progress=progress)
    split = [_split(folder, config.hold_out) for folder in folders]
    held, used = [each for each, _ in split], [each for _, each in split]
    keep_rows(out / "curve.csv", CURVE_FIELDS, run.step)
    losses: list[float] = []
    for drawn in _batches_ahead(used, config, run.step):
        losses.append(run.advance(drawn))
        if run.step % config.validate_every == 0 or run.step == config.steps:
            scores = {"train_loss": float(np.mean(losses)), **run.validate(held)}
            log_row(out / "curve.csv", CURVE_FIELDS, {"step": run.step, **scores})
            if on_metrics:
                on_metrics(run.step, scores)
            run.save()
            losses.clear()
        progress(run.step, config.steps, f"loss {losses[-1] if losses else 0:.3f}")
    torch.save(run.average.state_dict(), out / "outline.pth")
    return export(run.average, out / "outline.onnx")


def _split(folder: Path, hold_out: int) -> tuple[list[Pair], list[Pair]]:
    """Return the pairs that validate, one of ``hold_out``, and those that train."""
    pairs = load_pairs(folder)
    held, used = pairs[::hold_out], [pair for k, pair in enumerate(pairs) if k % hold_out]
    if not used:
        raise InputError(
            f"{folder / 'images'}: expected two images with an object, as one of them validates, "
            f"found {len(pairs)}"
        )
    return held, used


def export(model: OutlineNet, path: Path) -> Path:
    """Write the network as ONNX: shares of the object, not logits; any multiple of 16 pixels."""
    noise = np.random.default_rng(0).random((2, 4, 2 * MULTIPLE, 3 * MULTIPLE), dtype=np.float32)
    write_model(_Shares(model), path, NAMES, noise, {0: "photos", 2: "height", 3: "width"})
    return path


def outline_loss(logits: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean of the binary cross-entropy [scalar]; all [B, 1, S, S]."""
    each = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    return (each * weight).sum() / weight.sum()


def learning_rate(config: OutlineTrainConfig, step: int) -> float:
    """Half a cosine from ``lr`` to 1 % of it, after a short rise."""
    blend = 0.5 * (1 + math.cos(math.pi * step / config.steps))
    return config.lr * min(1.0, (step + 1) / WARMUP) * max(RATE_LEFT, blend)


class _Shares(nn.Module):
    def __init__(self, model: OutlineNet) -> None:
        super().__init__()
        self.model = model

    def forward(self, x: Tensor) -> Tensor:
        return torch.sigmoid(self.model(x))


class _Run:
    """A training under way: the network, its moving average, the optimiser, the step."""

    def __init__(self, config: OutlineTrainConfig, path: Path) -> None:
        self.config, self.path, self.step = config, path, 0
        model = OutlineNet()
        if config.start_from:
            load_weights(model, config.start_from, "the outline's network")
        self.model = model.train()
        self.average = deepcopy(self.model).eval()
        self.optimiser = torch.optim.Adam(self.model.parameters(), lr=config.lr)
        self.identity = config.model_dump_json(exclude={"threads", "validate_every"})
        state = read_checkpoint(path, self.identity, torch.device("cpu"))
        if state is not None:
            self.model.load_state_dict(state["model"])
            self.average.load_state_dict(state["average"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step = int(state["step"])

    def save(self) -> None:
        state = {
            "identity": self.identity,
            "step": self.step,
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        save_checkpoint(self.path, state)

    def advance(self, drawn: Drawn) -> float:
        """Take one step of Adam; returns the loss."""
        x, y, weight = (torch.from_numpy(array) for array in drawn)
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.config, self.step)
        reduced = self.config.precision == "bfloat16"
        with torch.autocast("cpu", torch.bfloat16, enabled=reduced):
            logits = self.model(x.contiguous(memory_format=torch.channels_last))
        loss = outline_loss(logits.float(), y, weight)
        if not math.isfinite(loss.item()):
            raise StageError(f"outline training: the loss is {loss.item()} at step {self.step}")
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        self.optimiser.step()
        follow(self.average, self.model, self.config.average, self.step)
        self.step += 1
        return float(loss.item())

    @torch.no_grad()
    def validate(self, held: list[list[Pair]]) -> dict[str, float]:
        """Score the averaged network on crops of held-out images."""
        losses: list[float] = []
        wrong: dict[str, list[float]] = {"wrong_before": [], "wrong_after": []}
        seed = self.config.seed + VALIDATION_SEED_SHIFT
        for k in range(VALIDATION_BATCHES):
            inputs, truths, weights = batch(held, seed, k, self.config.size, self.config.batch)
            logits: Tensor = self.average(torch.from_numpy(inputs))
            loss = outline_loss(logits, torch.from_numpy(truths), torch.from_numpy(weights))
            losses.append(float(loss.item()))
            real = truths > 0.5
            objects = np.maximum(1, real.sum((1, 2, 3)))
            wrong["wrong_before"] += list(((inputs[:, 3:] > 0.5) != real).sum((1, 2, 3)) / objects)
            wrong["wrong_after"] += list(((logits.numpy() > 0) != real).sum((1, 2, 3)) / objects)
        medians = {key: float(np.median(values)) for key, values in wrong.items()}
        return {"val_loss": float(np.mean(losses)), **medians}


def _batches_ahead(
    sources: list[list[Pair]], config: OutlineTrainConfig, start: int
) -> Iterator[Drawn]:
    """Yield the batches of the steps from ``start`` on; a thread draws the next one meanwhile."""

    def draw(step: int) -> Drawn:
        return batch(sources, config.seed, step, config.size, config.batch)

    with ThreadPoolExecutor(1) as ahead:
        waiting = ahead.submit(draw, start)
        for step in range(start, config.steps):
            drawn = waiting.result()
            waiting = ahead.submit(draw, step + 1)
            yield drawn
