"""A benchmark's TOML file, and configuration errors as sentences that name the field."""

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.errors import InputError


def describe(error: ValidationError, where: str) -> InputError:
    """Turn pydantic's report into one sentence per field, each naming field, rule and value."""
    lines = []
    for item in error.errors():
        field = ".".join(str(part) for part in item["loc"])
        rule = item["msg"].removeprefix("Value error, ")
        ours = item["type"] == "value_error"
        # a rule on a whole table names its field, and ours may say what they found
        told = ours and (isinstance(item["input"], dict) or ", found " in rule)
        found = "" if told or item["type"] == "missing" else f", found {item['input']!r}"
        if item["type"] == "extra_forbidden":
            lines.append(f"{where}: unknown key `{field}`")
        else:
            lines.append(f"{where}: {f'`{field}`: ' if field else ''}{rule}{found}")
    return InputError("\n".join(lines))


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file; raises :class:`InputError` naming the file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # no file, not UTF-8, not TOML
        raise InputError(f"{path}: expected a readable TOML file: {error}") from error


def load_toml(path: Path) -> BenchmarkConfig:
    """Read a benchmark's TOML file; raises :class:`InputError` naming file and field.

    Relative paths of captures, masks, ``lpips``, ``segment.model`` and ``run.dask_certificates``
    are taken from the file's own folder, which is also what ``{here}`` means to trainers.
    """
    data = read_toml(path)
    captures = data.get("captures")
    for capture in captures if isinstance(captures, list) else []:
        _place(capture, ("path", "masks"), path)
    _place(data.get("segment"), ("model",), path)
    _place(data.get("run"), ("dask_certificates",), path)
    _place(data, ("lpips",), path)
    segment = data.get("segment")
    model = segment.get("model") if isinstance(segment, dict) else None
    for field, file in (("lpips", data.get("lpips")), ("segment.model", model)):
        if isinstance(file, str) and not Path(file).is_file():
            raise InputError(f"{path}: `{field}`: expected a file of weights at {file}")
    trainers = data.get("trainers")
    for trainer in trainers.values() if isinstance(trainers, dict) else []:
        if isinstance(trainer, dict):
            trainer.setdefault("folder", str(path.parent.resolve()))
    try:
        return BenchmarkConfig.model_validate(data)
    except ValidationError as error:
        raise describe(error, str(path)) from error


def _place(table: object, keys: tuple[str, ...], file: Path) -> None:
    """Make paths of a file's table absolute; what is no table or no text is validated later."""
    for key in keys:
        if isinstance(table, dict) and isinstance(table.get(key), str):
            if "\0" in table[key]:
                raise InputError(f"{file}: `{key}`: expected a path, found {table[key]!r}")
            table[key] = str((file.parent / table[key]).resolve())
