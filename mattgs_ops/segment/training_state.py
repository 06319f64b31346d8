"""What every training of a network keeps: a moving average, a checkpoint, a curve."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from mattgs_ops.errors import InputError
from mattgs_ops.whole_file import written_whole


@torch.no_grad()
def follow(average: nn.Module, model: nn.Module, decay: float, step: int) -> None:
    """Move the average towards the network, faster in the first steps."""
    decay = min(decay, step / (step + 10))
    update = get_ema_multi_avg_fn(decay)  # type: ignore[no-untyped-call]  # torch leaves it untyped
    pairs = list(zip(_tensors(average), _tensors(model), strict=True))
    floats = [(mean, now) for mean, now in pairs if mean.is_floating_point()]
    update([mean for mean, _ in floats], [now for _, now in floats], step)
    for mean, now in pairs:
        if not mean.is_floating_point():
            mean.copy_(now)


def _tensors(model: nn.Module) -> list[torch.Tensor]:
    return [*model.parameters(), *model.buffers()]


def save_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Write a checkpoint as a whole or not at all."""
    with written_whole(path) as partial:
        torch.save(dict(state), partial)


def read_checkpoint(path: Path, identity: str, device: torch.device) -> dict[str, Any] | None:
    """Read what ``save_checkpoint`` wrote; None where there is no file.

    Raises :class:`InputError` for a broken file, and for one whose ``identity`` is another's.
    """
    if not path.is_file():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
        found = state["identity"]
    except Exception as error:  # torch raises a dozen types for a broken file
        raise InputError(f"{path}: expected a checkpoint of a training: {error}") from error
    if found != identity:
        raise InputError(
            f"{path}: expected a checkpoint of this configuration, found another's; "
            "give the training a folder of its own"
        )
    return state


def log_row(path: Path, fields: tuple[str, ...], row: Mapping[str, float]) -> None:
    """Add a line to a curve's CSV file, its head before the first."""
    new = not path.is_file()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields)
        if new:
            writer.writeheader()
        writer.writerow(dict(row))
