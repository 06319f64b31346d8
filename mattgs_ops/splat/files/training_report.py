"""``training.json``, beside the splats: how long a training took, on what, from where.

Apart from :mod:`mattgs_ops.splat.training.report`, which fills it, so that what reads or writes one
does not depend on the engine.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.splat.photos import Colour
from mattgs_ops.whole_file import write_text_whole

SCHEMA = 1
FILE = "training.json"


@dataclass(frozen=True)
class TrainingReport:
    """The content of ``training.json``; seconds are of the training loop alone.

    ``wall_seconds`` and ``cpu_seconds`` leave out reading, checkpoints, curve and final scoring;
    the parts of a resumed run add up. ``peak_memory_mib`` is the process's, libraries included;
    ``memory_bound_mib`` was stated before the start and leaves those out.
    """

    schema: int
    iterations: int
    resolution: int
    seed: int
    threads: int
    views: int
    splats: int
    starting_splats: int
    starting_source: str
    wall_seconds: float
    cpu_seconds: float
    calibration: float  # seconds of mattgs_ops.timing.calibration's workload, the fastest
    laps: tuple[dict[str, float], ...]  # mattgs_ops.splat.training.laps; empty for a resumed run
    resumed_from: int
    extent: float
    background: Colour  # behind the splats when they are scored
    schedule: dict[str, float]
    counters: dict[str, int]
    loss_terms: dict[str, float]
    peak_memory_mib: float
    memory_bound_mib: float
    digest: str
    trained_on: tuple[str, ...] = ()  # names of all photos; empty where a trainer does not tell

    def save(self, folder: Path) -> None:
        """Write ``folder/training.json``; it appears whole or not at all."""
        text = json.dumps(asdict(self), indent=1, sort_keys=True, allow_nan=False)
        write_text_whole(folder / FILE, text + "\n")

    @classmethod
    def load(cls, folder: Path) -> "TrainingReport":
        """Read ``folder/training.json``."""
        data: dict[str, Any] = json.loads((folder / FILE).read_text(encoding="utf-8"))
        for name in ("background", "laps", "trained_on"):
            data[name] = tuple(data.get(name, ()))
        return cls(**data)
