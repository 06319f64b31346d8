"""What every training of a network begins with and keeps.

Weights to go on from, a moving average, a checkpoint, a curve.
"""

import csv
from collections.abc import Mapping
from pathlib import Path
from textwrap import shorten
from typing import Any

import torch
from torch import nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from mattgs_ops.errors import InputError
from mattgs_ops.whole_file import written_whole

MOST_TOLD = 200  # characters of what torch says about weights: it lists every layer


def load_weights(model: nn.Module, path: Path, name: str) -> None:
    """Load a ``.pth`` of the network called ``name``, strictly.

    Raises :class:`InputError` naming the file when it cannot be read or holds other layers.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises a dozen types for a broken file
        told = shorten(str(error), MOST_TOLD)
        raise InputError(f"{path}: expected a file of PyTorch weights: {told}") from error
    if not isinstance(state, dict):
        raise InputError(f"{path}: expected a table of tensors, found {type(state).__name__}")
    try:
        model.load_state_dict(state, strict=True)
    except Exception as error:  # and some for a table of other things
        told = shorten(str(error), MOST_TOLD)
        raise InputError(f"{path}: expected the layers of {name}: {told}") from error


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


def keep_rows(path: Path, fields: tuple[str, ...], step: int) -> None:
    """Drop a curve's rows after ``step``, its first field: going on from there repeats them."""
    if not path.is_file():
        return
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    # a killed process may have left half a line at the end
    kept = [r for r in rows[1:] if len(r) == len(fields) and r[0].isdigit() and int(r[0]) <= step]
    with written_whole(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([fields, *kept])


def log_row(path: Path, fields: tuple[str, ...], row: Mapping[str, float]) -> None:
    """Add a line to a curve's CSV file, its head before the first."""
    new = not path.is_file()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields)
        if new:
            writer.writeheader()
        writer.writerow(dict(row))
