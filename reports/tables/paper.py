"""The paper's own values: read from a data file with provenance, never typed into code."""

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from reports.rows.schema import REQUIRED_METRICS

FILE = Path(__file__).with_name("paper_values.toml")
_IDENTITY = ("capture", "background", "method")


@dataclass(frozen=True)
class PaperValues:
    """``values`` by (capture, background, method), as of ``source``."""

    source: dict[str, Any]
    differences: tuple[str, ...]
    values: dict[tuple[str, str, str], dict[str, float]]

    def belong_to(self, iterations: int) -> bool:
        """Return whether they may stand in a table of so many iterations.

        A file that states ``source.iterations`` speaks of trainings of that length alone.
        """
        stated = self.source.get("iterations")
        return bool(self.values) and stated in (None, iterations)

    def line(self, capture: str, background: str, method: str) -> dict[str, float] | None:
        """Return the paper's line of a table, or None where it has none."""
        return self.values.get((capture, background, method))


def load(path: Path = FILE) -> PaperValues:
    """Read the values; raises :class:`InputError` for values without a source or unknown keys."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: expected a readable TOML file: {error}") from error
    source = data.get("source", {})
    entries = data.get("value", [])
    if entries and not source.get("read_from"):
        raise InputError(
            f"{path}: values need `source.read_from`: which version and page they were read from"
        )
    stated = source.get("iterations")
    if stated is not None and (isinstance(stated, bool) or not isinstance(stated, int)):
        raise InputError(
            f"{path}: `source.iterations`: expected a whole number of steps, found {stated!r}"
        )
    values: dict[tuple[str, str, str], dict[str, float]] = {}
    for entry in entries:
        key = (str(entry.get("capture")), str(entry.get("background")), str(entry.get("method")))
        where = f"{path}: value of {' '.join(key)}"
        unknown = sorted(set(entry) - {*_IDENTITY, *REQUIRED_METRICS})
        missing = [name for name in _IDENTITY if name not in entry]
        if unknown or missing:
            expected = f"{', '.join(_IDENTITY)} and some of {', '.join(REQUIRED_METRICS)}"
            problem = f"unknown {unknown}" if unknown else f"no {', '.join(missing)}"
            raise InputError(f"{where}: expected {expected}; found {problem}")
        if key in values:
            raise InputError(f"{where}: expected it once, found it twice")
        values[key] = {k: _number(v, f"{where}, `{k}`") for k, v in _numbers(entry).items()}
    differences = tuple(item["text"] for item in data.get("difference", []))
    return PaperValues(source, differences, values)


def _numbers(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if key not in _IDENTITY}


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{where}: expected a finite number (time in seconds), found {value!r}")
    return float(value)
