"""The paper's own values: read from a data file with provenance, never typed into code."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError
from reports.rows import REQUIRED_METRICS

FILE = Path(__file__).with_name("paper_values.toml")
_IDENTITY = ("capture", "background", "method")


@dataclass(frozen=True)
class PaperValues:
    """``values`` by (capture, background, method); empty where nobody has read them."""

    source: dict[str, Any]
    differences: tuple[str, ...]
    values: dict[tuple[str, str, str], dict[str, float]]

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
    values: dict[tuple[str, str, str], dict[str, float]] = {}
    for entry in entries:
        unknown = set(entry) - {*_IDENTITY, *REQUIRED_METRICS}
        missing = set(_IDENTITY) - set(entry)
        if unknown or missing:
            raise InputError(f"{path}: value {entry}: unknown {unknown}, missing {missing}")
        key = (entry["capture"], entry["background"], entry["method"])
        values[key] = {k: float(v) for k, v in entry.items() if k not in _IDENTITY}
    differences = tuple(item["text"] for item in data.get("difference", []))
    return PaperValues(source, differences, values)
