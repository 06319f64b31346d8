"""Configuration of the segmenter's training: frozen, validated, readable from TOML."""

from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError, model_validator

from mattgs_ops.config_file import describe, read_toml
from mattgs_ops.frozen import Frozen


class AugmentConfig(Frozen):
    """How far a training image may be changed; see ``augment``."""

    crop: float = Field(0.85, gt=0, le=1, description="smallest share of the side that is kept")
    rotation: float = Field(15.0, ge=0, le=180, description="degrees, to either side")
    flip_horizontal: float = Field(0.5, ge=0, le=1)
    flip_vertical: float = Field(0.1, ge=0, le=1)
    harsh: float = Field(
        0.0, ge=0, le=1, description="share of images with hard light: deep tones, shadows, casts"
    )
    close_ups: float = Field(
        0.0, ge=0, le=1, description="share of images that show a part of the object only"
    )
    cards: float = Field(
        0.0, ge=0, le=1, description="share of images with targets, charts or scale bars around"
    )


class WorldConfig(Frozen):
    """What composites show; shares are of the painted ones, the rest are cluttered desks."""

    plain: float = Field(0.4, ge=0, le=1, description="cloth, paper, bare tables, flash")
    walls: float = Field(0.12, ge=0, le=1, description="irregular things in front of a wall")
    rooms: float = Field(0.0, ge=0, le=1, description="tables, stands and floors in rooms")
    figures: float = Field(0.3, ge=0, le=1, description="share of objects that are smooth figures")
    turntables: float = Field(0.12, ge=0, le=1, description="share of objects that stand on a disc")

    @model_validator(mode="after")
    def _at_most_all(self) -> "WorldConfig":
        together = self.plain + self.walls + self.rooms
        if together > 1:
            raise ValueError(
                f"plain, walls and rooms: expected at most 1 together, found {together:g}"
            )
        return self


class FolderConfig(Frozen):
    """A user's own training data: photos, and masks named ``NAME.png`` after ``NAME``'s stem."""

    images: Path
    masks: Path
    share: float = Field(0.5, gt=0, le=1, description="share of a batch that comes from here")


class RenderedConfig(Frozen):
    """Path-traced views to train on, made before the first step; see ``rendered``."""

    desks: int = Field(4, ge=1, description="cluttered ones")
    plain: int = Field(
        0, ge=0, description="cloth, sweep, table, dark room with flash, turntable, wood, in turn"
    )
    rooms: int = Field(
        0, ge=0, description="floors, tables and pedestals in rooms, with sculpted objects"
    )
    figures: float = Field(
        0.0, ge=0, le=1, description="share of objects that are smooth figures, not in rooms"
    )
    objects: int = Field(6, ge=1, description="objects put on each place, one after another")
    views: int = Field(5, ge=1, description="of each object")
    empty: int = Field(12, ge=1, description="views of each place without an object")
    width: int = Field(224, ge=32, description="pixels; the height is three quarters of it")
    share: float = Field(0.3, gt=0, le=1, description="share of a batch that comes from the views")
    backdrops: float = Field(0.4, ge=0, le=1, description="share of composites painted on them")
    pasted: float = Field(
        0.0, ge=0, le=1, description="share of the views whose object is cut out, on another place"
    )
    seed: int = Field(1234, ge=0)

    @property
    def places(self) -> int:
        """Desks, plain grounds and rooms together."""
        return self.desks + self.plain + self.rooms


class StageConfig(Frozen):
    """One leg of the training: so many steps at one size."""

    size: int = Field(ge=32, description="side of the square that the network sees, pixels")
    batch: int = Field(ge=1)
    steps: int = Field(ge=1)
    lr: float = Field(1e-3, gt=0, description="Adam's rate at the leg's start")
    lr_end: float = Field(1e-3, gt=0, description="at its end; half a cosine between")


class SegmentTrainConfig(Frozen):
    """U²-Net training; small images first, because most is learnt there at a tenth of the cost."""

    variant: Literal["u2net", "u2netp"] = "u2netp"
    start_from: Path | None = Field(None, description="a .pth of weights to go on from")
    loss: Literal["bce", "bce_dice"] = Field("bce", description="bce is the paper's")
    stages: tuple[StageConfig, ...] = (
        StageConfig(size=96, batch=12, steps=1500, lr=2e-3, lr_end=1e-3),
        StageConfig(size=160, batch=8, steps=500, lr=1e-3, lr_end=4e-4),
        StageConfig(size=288, batch=4, steps=200, lr=4e-4, lr_end=1e-5),
    )
    composites: bool = Field(True, description="train on composites made on the fly")
    world: WorldConfig = WorldConfig()
    patterns: int = Field(3, ge=1, description="of each kind, that surfaces are covered with")
    reuse: int = Field(4, ge=1, description="times a composite is shown, differently augmented")
    pool: int = Field(400, ge=1, description="how many of the last composites are drawn from")
    rendered: RenderedConfig | None = Field(None, description="needs the `dev` extra")
    folders: tuple[FolderConfig, ...] = ()
    rescale: int = Field(512, ge=32, description="RescaleT: longest side of folder photos")
    augment: AugmentConfig = AugmentConfig()
    average: float = Field(0.995, ge=0, lt=1, description="decay of the weights' moving average")
    validate_every: int = Field(250, ge=1)
    validation_images: int = Field(24, ge=1)
    checkpoint_every: int = Field(100, ge=1)
    precision: Literal["float32", "bfloat16"] = Field(
        "float32", description="of the convolutions; bfloat16 halves the time on CPUs that have it"
    )
    threads: int = Field(1, ge=1)
    workers: int = Field(
        0, ge=0, description="processes that draw images ahead; 0 is a thread, enough for a CPU"
    )
    device: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int = Field(0, ge=0)

    @model_validator(mode="after")
    def _some_data(self) -> "SegmentTrainConfig":
        if not self.stages:
            raise ValueError("stages: expected at least one, found none")
        if not self.composites and not self.folders:
            raise ValueError("expected `composites` or at least one of `folders`, found neither")
        return self

    @property
    def steps(self) -> int:
        """All legs together."""
        return sum(stage.steps for stage in self.stages)


def load_train_config(path: Path) -> SegmentTrainConfig:
    """Read a TOML file; raises :class:`InputError` naming file and field.

    Relative paths are taken from the file's own folder.
    """
    data = read_toml(path)
    folders = data.get("folders")
    places = [(data, "start_from")]
    for folder in folders if isinstance(folders, list) else []:
        places += [(folder, "images"), (folder, "masks")]
    for table, key in places:
        if isinstance(table, dict) and isinstance(table.get(key), str):
            table[key] = str((path.parent / table[key]).resolve())
    try:
        return SegmentTrainConfig.model_validate(data)
    except ValidationError as error:
        raise describe(error, str(path)) from error
