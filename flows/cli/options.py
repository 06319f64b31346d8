"""The command line's options and a TOML file, merged into one :class:`BenchmarkConfig`."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mattgs_ops.config import BUNDLED, BenchmarkConfig
from mattgs_ops.config_file import describe, load_toml
from mattgs_ops.errors import InputError
from mattgs_ops.naming import capture_name

COMMAND_LINE = "command line"
CAMERA_FILE = re.compile(r"transforms(_train)?\.json")
OWN_SOURCES = ("photos", "capture", "video")  # options that name a capture of the user's own
SOURCES = (*OWN_SOURCES, "captures")
# options and fields of the deployments' forms that are settings of RunConfig
RUN_OPTIONS = (
    "workers",
    "threads",
    "retries",
    "stage_timeout",
    "store",
    "dask_scheduler",
    "dask_certificates",
    "notify",
)


def benchmark_config(file: Path | None, options: Mapping[str, Any]) -> BenchmarkConfig:
    """Merge a TOML file (or the defaults) with the options that were given.

    ``options`` are those of ``mattgs run``; None means not given. Raises :class:`InputError`
    naming the field.
    """
    base = BenchmarkConfig() if file is None else load_toml(file)
    given = {key: value for key, value in options.items() if value is not None}
    path = given.get("capture")
    if path is not None and path.is_file() and CAMERA_FILE.fullmatch(path.name):
        given["capture"] = path.parent  # nerfstudio's and NeRF's users name the file itself
    data = base.model_dump()
    captures = _captures(given)
    if captures is not None:
        data["captures"] = captures
    for key in ("iterations", "resolution", "conditions", "seeds"):
        if key in given:
            data[key] = given[key]
    for key in RUN_OPTIONS:
        if key in given:
            data["run"][key] = given[key]
    name = _name(given)
    if name is not None:
        data["name"] = name
    try:
        return BenchmarkConfig.model_validate(data)
    except ValidationError as error:
        raise describe(error, COMMAND_LINE) from error


def words(text: str | None) -> tuple[str, ...] | None:
    """Split ``a,b c`` at commas and blanks; None stays None."""
    return None if text is None else tuple(re.findall(r"[^,\s]+", text))


def numbers(text: str | None, option: str) -> tuple[int, ...] | None:
    """Split a list of whole numbers; raises :class:`InputError` naming the option."""
    try:
        return None if text is None else tuple(int(word) for word in words(text) or ())
    except ValueError as error:
        raise InputError(
            f"{option}: expected whole numbers such as 0,1,2, found {text!r}"
        ) from error


def size(text: str, option: str) -> tuple[int, int]:
    """Read ``WIDTHxHEIGHT``; raises :class:`InputError` naming the option."""
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)
    if found is None:
        raise InputError(f"{option}: expected WIDTHxHEIGHT such as 640x480, found {text!r}")
    return int(found[1]), int(found[2])


def _captures(given: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """Return the captures that the options name; None when they name none."""
    sources = [key for key in SOURCES if key in given]
    if len(sources) > 1:
        raise InputError(f"--{sources[0]} and --{sources[1]}: give one of them")
    masks = given.get("masks")
    if "frames" in given and sources != ["video"]:
        raise InputError("--frames: goes with --video")
    if not sources:
        if masks is not None:
            raise InputError("--masks: goes with --photos or --capture")
        return None
    if sources == ["captures"]:
        if masks is not None:
            raise InputError("--masks: goes with --photos or --capture, not with bundled captures")
        return [_bundled(name) for name in given["captures"]]
    path: Path = given[sources[0]]
    kind = "auto" if sources == ["capture"] else sources[0]
    own = {
        "name": given.get("name") or _name_of(path),
        "path": path.resolve(),
        "kind": kind,
        "masks": None if masks is None else masks.resolve(),
    }
    return [own | ({"frames": given["frames"]} if "frames" in given else {})]


def _bundled(name: str) -> dict[str, Any]:
    if name not in BUNDLED:
        raise InputError(
            f"--captures: no bundled capture is called {name!r}: expected some of "
            f"{', '.join(BUNDLED)}; for your own photos use --photos DIR"
        )
    return {"name": name}


def _name(given: Mapping[str, Any]) -> str | None:
    """Return the benchmark's name: as given, or the name of the user's own capture."""
    if "name" in given:
        return str(given["name"])
    own = next((given[key] for key in OWN_SOURCES if key in given), None)
    return None if own is None else _name_of(own)


def _name_of(path: Path) -> str:
    """Name a capture after its folder, the folder around ``images``, or its video."""
    folder = path.resolve()
    if folder.is_file():
        return capture_name(folder.stem)
    return capture_name(folder.parent.name if folder.name == "images" else folder.name)
