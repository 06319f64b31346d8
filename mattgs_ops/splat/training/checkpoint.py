"""Everything a training needs to go on after it was killed, in one NPZ file.

A checkpoint holds the splats, Adam's moments, the record for densification, the rest of the
epoch's view order, the state of every random stream, counters and the seconds spent. It carries a
digest of what is being trained (scene files that training reads, configuration, condition, seed);
one with another digest is not used. With one thread a resumed run ends in the same bits as one
that was never interrupted. The file appears whole or not at all.
"""

import hashlib
import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mattgs_ops.errors import StageError
from mattgs_ops.splat.exposure import Exposures
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.training.densify import Record
from mattgs_ops.splat.training.optimise import FIELDS, Adam
from mattgs_ops.whole_file import written_whole

SCHEMA = 3
FILE = "checkpoint.npz"
# Streams of their own, so that what one part draws never shifts another's: two methods with one
# seed see the views in the same order however many splats they split.
STREAMS = ("order", "background", "split", "mcmc")


@dataclass
class TrainingState:
    """A training between two steps."""

    splats: Splats
    adam: Adam
    record: Record
    streams: dict[str, np.random.Generator]
    step: int = 0
    order: list[int] = field(default_factory=list)  # views still to come in this epoch
    counters: dict[str, int] = field(default_factory=dict)
    wall_seconds: float = 0.0
    cpu_seconds: float = 0.0
    # what the method removed: positions and the step, [K, 4]
    pruned: Tensor = field(default_factory=lambda: torch.zeros(0, 4))
    exposures: Exposures | None = None  # where photos have an exposure of their own

    @classmethod
    def start(cls, splats: Splats, seed: int) -> "TrainingState":
        """Begin at step 0."""
        seeds = np.random.SeedSequence(seed).spawn(len(STREAMS))
        streams = {n: np.random.default_rng(s) for n, s in zip(STREAMS, seeds, strict=True)}
        return cls(splats, Adam(splats), Record.empty(len(splats)), streams)

    def count(self, name: str, more: int) -> None:
        """Add to one of the counters, which begin at 0."""
        self.counters[name] = self.counters.get(name, 0) + more


def digest(files: Iterable[Path], parameters: Mapping[str, Any]) -> str:
    """Return SHA-256 over the contents of ``files`` and the JSON of ``parameters``."""
    total = hashlib.sha256(json.dumps(parameters, sort_keys=True).encode())
    for path in files:
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def save(state: TrainingState, folder: Path, key: str) -> None:
    """Write ``folder/checkpoint.npz``."""
    arrays: dict[str, NDArray[Any]] = {"order": np.array(state.order, dtype=np.int64)}
    for name, tensor in _tensors(state).items():
        arrays[name] = tensor.numpy()
    arrays["pruned"] = state.pruned.numpy()
    meta = {
        "schema": SCHEMA,
        "digest": key,
        "step": state.step,
        "adam_steps": state.adam.steps,
        "streams": {name: rng.bit_generator.state for name, rng in state.streams.items()},
        "counters": state.counters,
        "wall_seconds": state.wall_seconds,
        "cpu_seconds": state.cpu_seconds,
        "exposure_iterations": state.exposures and state.exposures.iterations,
    }
    arrays["meta"] = np.array(json.dumps(meta))
    with written_whole(folder / FILE) as partial, partial.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load(folder: Path, key: str) -> TrainingState | None:
    """Read ``folder/checkpoint.npz`` if it is there and of this training.

    Raises :class:`StageError` when the file is damaged.
    """
    path = folder / FILE
    if not path.exists():
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            meta = json.loads(str(data["meta"]))
            if meta["schema"] != SCHEMA or meta["digest"] != key:
                return None
            arrays = {name: data[name] for name in data.files if name != "meta"}
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise StageError(f"{path}: expected a checkpoint, found a damaged file: {error}") from error
    splats = Splats(**{name: torch.from_numpy(arrays[f"splats.{name}"]) for name in FIELDS})
    state = TrainingState(
        splats=splats,
        adam=Adam(splats),
        record=Record.empty(len(splats)),
        streams={name: _stream(meta["streams"][name]) for name in STREAMS},
        step=meta["step"],
        order=[int(i) for i in arrays["order"]],
        counters=meta["counters"],
        wall_seconds=meta["wall_seconds"],
        cpu_seconds=meta["cpu_seconds"],
        pruned=torch.from_numpy(arrays["pruned"]),
    )
    state.adam.steps = meta["adam_steps"]
    if "exposures.matrices" in arrays:
        views = len(arrays["exposures.matrices"])
        state.exposures = Exposures.identity(views, meta["exposure_iterations"])
    for name, tensor in _tensors(state).items():
        tensor.copy_(torch.from_numpy(arrays[name]))
    return state


def _tensors(state: TrainingState) -> dict[str, Tensor]:
    named = {f"splats.{name}": getattr(state.splats, name) for name in FIELDS}
    named |= {f"first.{name}": state.adam.first[name] for name in FIELDS}
    named |= {f"second.{name}": state.adam.second[name] for name in FIELDS}
    named |= {f"record.{f.name}": getattr(state.record, f.name) for f in fields(Record)}
    if state.exposures is not None:
        named |= {f"exposures.{name}": t for name, t in state.exposures.tensors().items()}
    return named


def _stream(state: dict[str, Any]) -> np.random.Generator:
    rng = np.random.default_rng()
    rng.bit_generator.state = state
    return rng
