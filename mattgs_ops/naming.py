"""Names and relative paths that come from outside and may become paths here.

Names of captures, methods and benchmarks become folders and files. Manifests of a shared store,
rows and scenes name files relative to a folder. Each may have been written by somebody else: a name
such as ``../../evil`` must never read or write outside the folder that it is meant for. Every
module that joins such a text to a folder checks it here.

Only the text is looked at: no folder that the project fills from outside holds links.

:func:`slug` is for the other way: it makes file names, keys and anchors of what people wrote, and
:func:`numbers_by_value` says in which order names come, :func:`listed_names` tells many of them.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator

from mattgs_ops.errors import InputError

MOST_LETTERS = 64  # a file's name is made of several names; most file systems take 255 bytes
FILE_NAME = "._+-"  # what names may hold besides ASCII letters and digits
NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9{re.escape(FILE_NAME)}]*")
NAME_RULE = f"expected letters, digits and . _ + -, a letter or digit first, {MOST_LETTERS} at most"
PATH_RULE = "expected a path below its folder: relative, without `..`"
# Fields of a row that are names, and how long they may be: a condition has its background too.
ROW_NAMES = dict.fromkeys(("benchmark", "capture", "method", "run_id"), MOST_LETTERS) | {
    "condition": len("original-") + MOST_LETTERS
}


def is_name(text: object, most: int = MOST_LETTERS) -> bool:
    """Whether a text is a name: one part of a path, no hidden file, ``most`` letters at most."""
    return isinstance(text, str) and len(text) <= most and NAME.fullmatch(text) is not None


def _valid_name(text: str) -> str:
    if not is_name(text):
        raise ValueError(NAME_RULE)
    return text


Name = Annotated[str, AfterValidator(_valid_name)]


def checked_name(text: str, field: str) -> str:
    """Return the text if it is a name; raises :class:`InputError` naming the field."""
    if not is_name(text):
        raise InputError(f"{field}: {NAME_RULE}, found {text!r}")
    return text


def is_below(path: object) -> bool:
    """Whether a text is a relative path, with forward slashes, that stays below its folder."""
    if not isinstance(path, str) or "\0" in path:
        return False
    return all(part not in ("", ".", "..") for part in path.split("/"))


def below(folder: Path, path: str, field: str) -> Path:
    """Join a relative path to its folder.

    Raises :class:`InputError` naming the field when the path would lead out of the folder.
    """
    if not is_below(path):
        raise InputError(f"{field}: {PATH_RULE}, found {path!r}")
    return folder / path


def slug(text: str, keep: str = FILE_NAME) -> str:
    """Turn each run of what is neither an ASCII letter, a digit nor in ``keep`` into one dash."""
    return re.sub(rf"[^A-Za-z0-9{re.escape(keep)}]+", "-", text)


def numbers_by_value(name: str) -> tuple[tuple[str | int, ...], str]:
    """Return what to sort names by so that ``2.jpg`` comes before ``10.jpg``, as file managers do.

    Frames of a video and numbered photos are in the order in which they were taken then: neighbours
    overlap, and every so-many-th is evenly spaced.
    """
    parts = re.split(r"([0-9]+)", name)
    return tuple(int(part) if place % 2 else part for place, part in enumerate(parts)), name


def listed_names(names: Sequence[str], most: int) -> str:
    """List names in one sentence: the first ``most``, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def capture_name(folder: str) -> str:
    """Turn any folder's name into one that a capture may have."""
    return slug(folder).strip(FILE_NAME)[:MOST_LETTERS] or "capture"


def row_problems(row: Mapping[str, Any]) -> list[str]:
    """Return which fields of an experiment's row cannot be names or paths; none is good.

    Missing fields and None are left to the schema of rows.
    """
    found = [
        f"`{field}`: {NAME_RULE}, found {row[field]!r}"
        for field in ROW_NAMES
        if row.get(field) is not None and not is_name(row[field], ROW_NAMES[field])
    ]
    artifacts = row.get("artifacts")
    for kind, path in artifacts.items() if isinstance(artifacts, Mapping) else ():
        if not is_below(path):
            found.append(f"`artifacts.{kind}`: {PATH_RULE}, found {path!r}")
    return found


def checked_row(row: Any, where: str) -> dict[str, Any]:
    """Return the row; raises :class:`InputError` naming ``where`` and the fields in question."""
    if not isinstance(row, dict):
        raise InputError(f"{where}: expected a row, found {type(row).__name__}")
    wrong = row_problems(row)
    if wrong:
        raise InputError(f"{where}: {'; '.join(wrong)}")
    return row
