"""The benchmark's configuration: frozen, validated, parameters only.

One object is the Prefect flow's parameter, the TOML file and the command line alike. Unknown keys
and bad values are refused by name. Nothing heavy is imported here, so that ``mattgs --help`` and
validation are instant. Values that change results are part of a stage's key.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from mattgs_ops.frozen import Background, Frozen, Seed
from mattgs_ops.method import METHODS, MethodConfig, unfolded
from mattgs_ops.naming import Name
from mattgs_ops.trainer import TrainerConfig

FEWEST_SPLATS = 100  # that a training may be limited to
BUNDLED = ("rover", "hexapod", "lattepanda")


class CaptureConfig(Frozen):
    """Where a capture comes from; no ``path`` means the bundled one called ``name``."""

    name: Name
    path: Path | None = None
    kind: Literal["auto", "photos", "nerfstudio", "colmap", "video"] = "auto"
    masks: Path | None = Field(None, description="folder of the user's own masks, 255 = object")
    frames: int = Field(60, ge=3, description="photos taken from a video")

    @model_validator(mode="after")
    def _bundled_or_path(self) -> "CaptureConfig":
        if self.path is None and self.name not in BUNDLED:
            raise ValueError(
                f"no bundled capture is called {self.name!r}: expected one of "
                f"{', '.join(BUNDLED)}, or a `path` to photos"
            )
        return self


class SegmentConfig(Frozen):
    """How the object is cut out (U²-Net, Qin et al. 2020)."""

    source: Literal["auto", "u2net", "grabcut", "given", "none"] = Field(
        "auto",
        description="auto: masks that come with the capture's photos as alpha or by the "
        "user's --masks are used, bundled captures and plain photos are segmented by U²-Net",
    )
    model: Path | None = Field(None, description="an ONNX file; none means the bundled one")
    threshold: float = Field(0.5, gt=0, lt=1)
    refine: Literal["none", "grabcut", "votes"] = Field(
        "votes",
        description="votes: once cameras are known, all views vote on the masks of each; "
        "grabcut: each photo by its colours; none: the map's threshold",
    )


class SfmConfig(Frozen):
    """Structure-from-motion by pycolmap (Schönberger & Frahm 2016)."""

    mode: Literal["shared", "masked", "original"] = "shared"
    poses: Literal["auto", "estimate"] = Field(
        "auto",
        description="auto: poses that come with a user's capture are kept, SfM only "
        "triangulates; estimate: always ignore them. Bundled captures are always estimated",
    )
    points: Literal["auto", "triangulate"] = Field(
        "auto",
        description="auto: points that come with a user's poses (COLMAP's points3D, nerfstudio's "
        "ply_file_path) are started from; triangulate: always find them anew",
    )
    camera_model: Literal[
        "SIMPLE_PINHOLE",
        "PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "OPENCV",
        "FULL_OPENCV",
        "OPENCV_FISHEYE",
    ] = "SIMPLE_RADIAL"
    max_image_size: int = Field(1600, ge=64, description="longest side seen by SIFT, pixels")
    max_features: int = Field(
        2048, ge=64, description="of a photo, and as many of its object; largest scales first"
    )
    upsample: bool = Field(True, description="SIFT starts at twice the photos' size")
    peak_threshold: float = Field(0.02 / 3, gt=0, description="SIFT's; lower finds fainter ones")
    mapper: Literal["incremental", "global"] = "incremental"
    matcher: Literal["auto", "exhaustive", "sequential", "similar"] = "auto"
    exhaustive_limit: int = Field(25, ge=2, description="auto: all pairs up to this many views")
    similar_limit: int = Field(120, ge=2, description="auto: similar pairs up to this many")
    min_registered: float = Field(0.5, gt=0, le=1, description="share of views; fewer is a failure")
    random_points: int = Field(
        10_000, ge=100, description="stated fallback when no point can be triangulated"
    )
    seed: int = Field(0, ge=0)


class TrainConfig(Frozen):
    """3DGS training (Kerbl et al. 2023); the defaults are their released values for 30,000 steps.

    Schedules given in steps are scaled by ``iterations / 30,000`` when ``scale_schedule`` is set,
    as gsplat's ``steps_scaler`` does.
    """

    scale_schedule: bool = True
    lr_position: float = Field(1.6e-4, gt=0, description="times the scene's extent")
    lr_position_final: float = Field(1.6e-6, gt=0)
    lr_sh_dc: float = Field(2.5e-3, gt=0)
    lr_sh_rest: float = Field(2.5e-3 / 20, gt=0)
    lr_opacity: float = Field(0.025, gt=0, description="0.05 in the paper, 0.025 as released since")
    lr_scale: float = Field(5e-3, gt=0)
    lr_rotation: float = Field(1e-3, gt=0)
    ssim_lambda: float = Field(0.2, ge=0, le=1)
    sh_degree: int = Field(3, ge=0, le=3)
    sh_every: int = Field(1000, ge=1)
    densify_from: int = Field(500, ge=0)
    densify_until: int = Field(15_000, ge=0, description="growth mcmc: always 25,000, as released")
    densify_every: int = Field(100, ge=1)
    densify_gradient: float = Field(2e-4, gt=0, description="normalised device coordinates")
    densify_scale: float = Field(0.01, gt=0, description="split above this share of the extent")
    prune_opacity: float = Field(0.005, ge=0, lt=1)
    opacity_reset_every: int = Field(3000, ge=1)
    max_splats: int = Field(
        300_000, ge=FEWEST_SPLATS, description="no more are started from or added"
    )
    background: Literal["white", "black", "random"] = "white"
    exposure: Literal["auto", "affine", "off"] = Field(
        "auto",
        description="affine: each training photo has an affine change of colour of its own, found "
        "with the splats; auto: for a user's captures, not for bundled ones",
    )
    checkpoint_every: int = Field(1000, ge=0, description="0: never")


NO_RESULT = ("checkpoint_every",)  # of TrainConfig: when to save never changes what comes out


class Condition(Frozen):
    """Background × method, written ``nobg-ours``."""

    background: Background
    method: str

    def __str__(self) -> str:
        return f"{self.background}-{self.method}"

    @classmethod
    def parse(cls, text: str) -> "Condition":
        """Read ``BACKGROUND-METHOD``; raises ValueError naming the text."""
        background, dash, method = text.partition("-")
        if background not in ("original", "nobg") or not dash or not method:
            raise ValueError(
                f"condition {text!r}: expected BACKGROUND-METHOD with the background `original` "
                "or `nobg`, for example `nobg-ours`"
            )
        return cls.model_validate({"background": background, "method": method})


PAPER_CONDITIONS = ("original-3dgs", "original-ours", "nobg-3dgs", "nobg-ours")
CONDITIONS = (*PAPER_CONDITIONS, "original-ours+", "nobg-ours+")


class RunConfig(Frozen):
    """Where and how wide the work runs; never changes a result."""

    workers: int = Field(0, ge=0, description="Dask worker processes; 0: one per core")
    threads: int = Field(1, ge=1, description="threads of one training")
    stage_timeout: float = Field(6 * 3600, gt=0, description="seconds one stage may take")
    retries: int = Field(1, ge=0, description="of a stage whose process crashed or was killed")
    memory: float = Field(
        0, ge=0, description="bytes that one training asks of a Dask worker's resources; 0: none"
    )
    dask_scheduler: str | None = Field(
        None, pattern=r"^(tcp|tls)://\S+:\d+$", description="address of an existing scheduler"
    )
    dask_certificates: Path | None = Field(
        None, description="folder with ca.pem, cert.pem and key.pem for tls://"
    )
    sitting: str | None = Field(
        None, description="measures speed anew: a name that no earlier measurement had"
    )
    notify: str | None = Field(
        None,
        pattern=r"^(https?://\S+|[a-z0-9-]+/[a-z0-9-]+)$",
        description="told of a failed run: TYPE/NAME of a block of Prefect's, or a URL for a POST",
    )
    store: str | None = Field(None, description="s3://… or another fsspec URL for finished stages")
    checkpoint_copy_every: float = Field(
        600, ge=0, description="seconds between copies of a checkpoint to `store`; 0: none"
    )

    @model_validator(mode="after")
    def _certificates_are_used(self) -> "RunConfig":
        if self.dask_certificates and not str(self.dask_scheduler).startswith("tls://"):
            raise ValueError("dask_certificates: goes with dask_scheduler tls://HOST:PORT")
        return self


# Scoring all of 42 training views takes as long as a third of a training of 1,000 iterations
QUICK_ITERATIONS, QUICK_TRAIN_VIEWS = 2000, 7


class BenchmarkConfig(Frozen):
    """A grid of experiments: captures × conditions × seeds."""

    name: Name = "quick"
    captures: tuple[CaptureConfig, ...] = tuple(CaptureConfig(name=n) for n in BUNDLED)
    conditions: tuple[str, ...] = CONDITIONS
    seeds: tuple[Seed, ...] = (0,)
    iterations: int = Field(1000, ge=1)
    resolution: int = Field(320, ge=16, description="longest side of training views, pixels")
    train_views: int = Field(
        0,
        ge=0,
        description="at most so many training views, every n-th, are scored beside all held-out "
        "ones; 0: all, and at most 7 in trainings of up to 2,000 iterations",
    )
    lpips: Path | None = Field(None, description="LPIPS's weights; none: it is not scored")
    test_every: int = Field(8, ge=2, description="every 8th view by name is held out")
    segment: SegmentConfig = SegmentConfig()
    sfm: SfmConfig = SfmConfig()
    train: TrainConfig = TrainConfig()
    methods: dict[Name, MethodConfig] = Field(
        default_factory=dict,
        description="further methods, or other settings of known ones; `like` names a built-in "
        "method whose settings stand where a table is silent",
    )
    trainers: dict[Name, TrainerConfig] = Field(
        default_factory=dict, description="other programs, each a method under its name"
    )
    budgets: tuple[Annotated[int, Field(ge=FEWEST_SPLATS)], ...] = Field(
        (), description="numbers of splats that none may exceed; every condition is run with each"
    )
    run: RunConfig = RunConfig()

    @field_validator("methods", mode="before")
    @classmethod
    def _like_another(cls, value: object) -> object:
        if not isinstance(value, dict):
            return value
        return {name: unfolded(table) for name, table in value.items()}

    @field_validator("captures", "conditions", "seeds", "budgets")
    @classmethod
    def _some_and_unique(
        cls, value: tuple[object, ...], info: ValidationInfo
    ) -> tuple[object, ...]:
        keys = [v.name if isinstance(v, CaptureConfig) else v for v in value]
        if not keys and info.field_name != "budgets":
            raise ValueError("expected at least one, found none")
        if len(set(keys)) != len(keys):
            raise ValueError(f"expected different ones, found {', '.join(map(str, keys))}")
        return value

    @model_validator(mode="after")
    def _check_conditions(self) -> "BenchmarkConfig":
        both = sorted(self.trainers.keys() & (METHODS | self.methods).keys())
        if both:
            raise ValueError(f"trainers.{both[0]}: a method has that name; give it another")
        for text in self.conditions:
            try:
                self.method_settings(Condition.parse(text).method)
            except ValueError as error:
                raise ValueError(f"`conditions`: {error}") from error
        return self

    def train_settings(self, capture: str, budget: int | None = None) -> TrainConfig:
        """Return the training's settings for a capture, with nothing left to choose."""
        changed: dict[str, object] = {} if budget is None else {"max_splats": budget}
        if self.train.exposure == "auto":
            own = next(c for c in self.captures if c.name == capture).path is not None
            changed["exposure"] = "affine" if own else "off"
        return self.train.model_copy(update=changed)

    def budgets_of(self, condition: str) -> tuple[int | None, ...]:
        """Return the numbers of splats that a condition is run with; None: no limit of its own."""
        trainer = self.trainers.get(Condition.parse(condition).method)
        limited = trainer is None or trainer.takes_budget
        return self.budgets if self.budgets and limited else (None,)

    @property
    def scored_train_views(self) -> int | None:
        """Return how many training views are scored, None for all."""
        if self.train_views:
            return self.train_views
        return QUICK_TRAIN_VIEWS if self.iterations <= QUICK_ITERATIONS else None

    def method(self, name: str) -> MethodConfig:
        """Return the settings of a method; raises ValueError naming the known ones."""
        known = METHODS | self.methods
        if name not in known:
            listed = ", ".join(sorted(known.keys() | self.trainers.keys()))
            raise ValueError(f"method {name!r}: expected one of {listed}")
        return known[name]

    def method_settings(self, name: str) -> dict[str, Any]:
        """Return what a method, or a trainer, is set to, as JSON values; raises as `method`."""
        if name in self.trainers:
            return self.trainers[name].model_dump(mode="json", exclude={"folder", "timeout"})
        return self.method(name).model_dump(mode="json")
