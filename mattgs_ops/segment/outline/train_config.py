"""Configuration of the outline's training: frozen, validated, readable from TOML."""

from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from mattgs_ops.config_file import describe, read_toml
from mattgs_ops.frozen import Frozen
from mattgs_ops.segment.network.train_config import RenderedConfig, WorldConfig


class PaintedConfig(Frozen):
    """Composites that are drawn before the first step; see ``training_images.composites``."""

    count: int = Field(500, ge=2, description="one of them validates, at least")
    size: int = Field(640, ge=32, description="side, pixels: photos' resolution, not a network's")
    world: WorldConfig = WorldConfig()
    seed: int = Field(777, ge=0)


class OutlineTrainConfig(Frozen):
    """On what images, how long; every source of images has the same share of the crops."""

    start_from: Path | None = Field(None, description="a .pth of weights to go on from")
    painted: PaintedConfig | None = PaintedConfig()
    rendered: tuple[RenderedConfig, ...] = Field(
        (), description="path-traced, needs the `dev` extra; `share` and `backdrops` say nothing"
    )
    steps: int = Field(6000, ge=1)
    size: int = Field(160, ge=32, multiple_of=16, description="side of a crop, pixels")
    batch: int = Field(16, ge=1)
    lr: float = Field(2e-3, gt=0, description="Adam's, at the start; half a cosine to 1 % of it")
    average: float = Field(0.998, ge=0, lt=1, description="decay of the weights' moving average")
    hold_out: int = Field(40, ge=2, description="one of so many images validates and trains not")
    validate_every: int = Field(250, ge=1)
    precision: Literal["float32", "bfloat16"] = Field(
        "float32", description="of the convolutions; bfloat16 is faster on CPUs that have it"
    )
    threads: int = Field(1, ge=1)
    seed: int = Field(0, ge=0)


def load_outline_config(path: Path) -> OutlineTrainConfig:
    """Read a TOML file; raises :class:`InputError` naming file and field.

    A relative ``start_from`` is taken from the file's own folder.
    """
    data = read_toml(path)
    if isinstance(data.get("start_from"), str):
        data["start_from"] = str((path.parent / data["start_from"]).resolve())
    try:
        return OutlineTrainConfig.model_validate(data)
    except ValidationError as error:
        raise describe(error, str(path)) from error
