"""Another program that trains splats: a table ``[trainers.NAME]`` of a benchmark's TOML file.

NAME is then a method like any other: ``original-NAME`` and ``nobg-NAME`` are its conditions. The
program is a command, never a shell's; :mod:`mattgs_ops.trainers` runs it.
"""

import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from mattgs_ops.frozen import Frozen
from mattgs_ops.naming import is_below

Layout = Literal["colmap", "nerfstudio", "nerf"]
PLACEHOLDERS = {
    "data": "folder of the training views, in the layout",
    "output": "empty folder that the program writes into, and runs in",
    "iterations": "steps of the training",
    "resolution": "longest side of the training views, pixels; they have that size already",
    "seed": "seed of the experiment",
    "threads": "threads of one training",
    "budget": "most splats that it may have, where the benchmark has `budgets`",
    "here": "folder of the benchmark's file",
    "python": "the Python that runs this project, for a script of your own",
}
PLACEHOLDER = re.compile(r"\{([A-Za-z_]+)\}")
FOLDERS = ("data", "output", "here", "python")  # those that stand for paths
FIXED = ("here", "python")  # the placeholders that mean something before there is an experiment


def _check_command(arguments: tuple[str, ...]) -> tuple[str, ...]:
    if not arguments or not arguments[0]:
        raise ValueError('expected a program and its arguments as a list, such as ["opensplat"]')
    _check_placeholders(arguments)
    return arguments


def _check_placeholders(arguments: Iterable[str]) -> None:
    for argument in arguments:
        for name in PLACEHOLDER.findall(argument):
            if name not in PLACEHOLDERS:
                raise ValueError(
                    f"unknown placeholder {{{name}}}: expected one of "
                    f"{', '.join(f'{{{known}}}' for known in PLACEHOLDERS)}"
                )


Command = Annotated[tuple[str, ...], AfterValidator(_check_command)]


class TrainerConfig(Frozen):
    """How to run a program, what it reads, and where its splats are then."""

    command: Command = Field(description="program and arguments; the placeholders are filled in")
    layout: Layout = Field(
        "colmap",
        description="how the training views are written: images/ and sparse/0/*.bin; "
        "transforms.json and points.ply; transforms_train.json, as the NeRF scenes have it",
    )
    version: Command | None = Field(
        None,
        description="a command that prints the version first; only {here} and {python} are known "
        "to it",
    )
    result: str | None = Field(
        None,
        description="the splats' file below {output}, a pattern such as `*/point_cloud.ply`, with "
        "placeholders; None: the one .ply, .splat or .spz that lies there",
    )
    progress: str | None = Field(
        None,
        description="regular expression whose first group is the step that a line of its output "
        "tells; None: `step 7`, `iteration 7`, `7/1000`",
    )
    timeout: float | None = Field(
        None, gt=0, description="seconds; None: `run.stage_timeout`, as for every stage"
    )
    environment: dict[str, str] = Field(
        default_factory=dict,
        description="environment variables beside those of this process, with placeholders",
    )
    folder: Path = Field(Path(), description="what {here} stands for; set when a file is read")

    @model_validator(mode="after")
    def _usable(self) -> "TrainerConfig":
        for name in PLACEHOLDER.findall(" ".join(self.version or ())):
            if name not in FIXED:
                raise ValueError(f"`version`: {{{name}}} is not known before a training")
        _check_placeholders(self.environment.values())
        if self.result is not None:
            _check_result(self.result)
        if self.progress is not None:
            try:
                groups = re.compile(self.progress).groups
            except re.error as error:
                raise ValueError(f"`progress`: not a regular expression: {error}") from error
            if groups < 1:
                raise ValueError("`progress`: expected a group around the step's number")
        return self

    @property
    def takes_budget(self) -> bool:
        """Whether the program can be told how many splats it may have."""
        told = (*self.command, *self.environment.values())
        return any("{budget}" in argument for argument in told)

    @property
    def fixed(self) -> dict[str, object]:
        """What the placeholders of ``FIXED`` stand for."""
        return {"here": self.folder, "python": sys.executable}


def _check_result(pattern: str) -> None:
    """Raise for a pattern that finds nothing below {output}, after a whole training."""
    if not is_below(pattern):
        raise ValueError(f"`result`: expected a path below {{output}}, found {pattern!r}")
    _check_placeholders([pattern])
    for name in PLACEHOLDER.findall(pattern):
        if name in FOLDERS:
            raise ValueError(f"`result`: is below {{output}} already; {{{name}}} is another path")
    if any("**" in part and part != "**" for part in pattern.split("/")):
        raise ValueError(f"`result`: expected ** as a whole folder, found {pattern!r}")


def fill(text: str, values: Mapping[str, object]) -> str:
    """Put values where their placeholders stand; those without a value stay."""
    return PLACEHOLDER.sub(
        lambda found: str(values[found[1]]) if found[1] in values else found[0], text
    )
