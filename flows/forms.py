"""The parameters of the deployments, as models: Prefect's interface makes forms of them.

A field that is left empty is as the TOML file ``config`` says, else as in ``mattgs run``. Prefect's
server refuses a run whose parameters do not fit, before a worker sees it.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from flows.cli.arguments import DEFAULT_OUT
from flows.cli.options import RUN_OPTIONS
from mattgs_ops.frozen import Frozen, Seed
from mattgs_ops.naming import Name
from reports.gate.tolerances import Doubt

# Literals, for a menu: the same as config.BUNDLED and config.CONDITIONS, which a test compares
Bundled = Literal["rover", "hexapod", "lattepanda"]
Built = Literal[
    "original-3dgs",
    "original-ours",
    "nobg-3dgs",
    "nobg-ours",
    "original-ours+",
    "nobg-ours+",
]
GRID_OPTIONS = ("captures", "photos", "conditions", "seeds", "iterations", "resolution")
Notify = Annotated[
    str | None,
    Field(
        title="Message on failure",
        description="TYPE/NAME of a notification block, or a URL that takes a POST",
    ),
]
Out = Annotated[
    Path, Field(title="Output folder", description="on the worker; relative to its folder")
]


class GridForm(Frozen):
    """A benchmark: captures × conditions × seeds."""

    name: Name = Field("grid", title="Name", description="of the benchmark")
    config: Path | None = Field(
        None,
        title="TOML file",
        description="on the worker, with captures, methods and settings of your own",
    )
    captures: tuple[Bundled, ...] | None = Field(
        None, title="Captures", description="bundled ones", min_length=1
    )
    photos: Path | None = Field(
        None, title="Photos", description="a folder on the worker, in place of bundled captures"
    )
    conditions: tuple[Built, ...] | None = Field(
        None,
        title="Conditions",
        description="background and method; methods of your own: in the TOML file",
        min_length=1,
    )
    seeds: tuple[Seed, ...] | None = Field(
        None, title="Seeds", description="one training each", min_length=1
    )
    iterations: int | None = Field(None, title="Iterations", ge=1, description="training steps")
    resolution: int | None = Field(
        None, title="Resolution", ge=16, description="longest side of training views, pixels"
    )
    remeasure: bool = Field(
        True, title="Measure speed anew", description="also where no code has changed"
    )
    workers: int | None = Field(None, title="Workers", ge=0, description="0: one per core")
    threads: int | None = Field(None, title="Threads", ge=1, description="of one training")
    retries: int | None = Field(
        None, title="Retries", ge=0, description="of a stage whose process crashed"
    )
    stage_timeout: float | None = Field(
        None, title="Time limit", gt=0, description="seconds that one stage may take"
    )
    store: str | None = Field(
        None, title="Store", description="s3://BUCKET/FOLDER or another URL, shared by machines"
    )
    dask_scheduler: str | None = Field(
        None, title="Dask scheduler", description="tcp://HOST:PORT or tls://HOST:PORT"
    )
    dask_certificates: Path | None = Field(
        None, title="Dask certificates", description="folder with ca.pem, cert.pem and key.pem"
    )
    notify: Notify = None
    out: Out = DEFAULT_OUT

    def options(self) -> dict[str, Any]:
        """Return what ``flows/cli/options.py`` merges with the TOML file."""
        return {"name": self.name} | {
            key: getattr(self, key) for key in (*GRID_OPTIONS, *RUN_OPTIONS)
        }


class GateForm(Frozen):
    """How a benchmark is judged."""

    baseline: str = Field(
        title="Baseline",
        description="a JSON file, the name of a committed one, or an alias in the registry",
    )
    doubt: Doubt = Field(
        Doubt.MARGIN,
        title="Doubt",
        description="which inconclusive numbers end as a failure: all, those whose estimate is a "
        "loss beyond its margin, or none",
    )
    must_see: bool = Field(
        False,
        title="Must see",
        description="fail when a loss planted into the baseline would go unnoticed",
    )


class NightlyForm(GridForm):
    """A benchmark, and the gate on it."""

    gate: GateForm = Field(title="Gate")


class JudgeForm(GateForm):
    """A recorded benchmark, and what it is compared with."""

    benchmark: Name = Field(title="Benchmark")
    notify: Notify = None
    out: Out = DEFAULT_OUT


class SegmenterForm(Frozen):
    """A training of U²-Net."""

    folder: Path = Field(
        DEFAULT_OUT / "segmenter", title="Folder", description="for weights, curve and ONNX file"
    )
    config: Path | None = Field(None, title="TOML file", description="of the training")
    notify: Notify = None
    out: Out = DEFAULT_OUT
