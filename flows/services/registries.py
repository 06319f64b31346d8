"""Which MLflow registries the runs of an output folder were recorded in, also in other sittings.

``MLFLOW_TRACKING_URI`` may be set in one shell and not in the next. What a folder's registries are
is kept in it, so that cleaning asks all of them what is still referred to.
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path

from mattgs_ops.errors import InputError
from tasks.registry.upkeep.moved import DATABASE

SQLITE = "sqlite:///"
FILE = "registries.txt"  # one address a line, without passwords


def own(out: Path) -> str:
    """Return the address of the SQLite file below ``out``, the default."""
    return f"{SQLITE}{(out / DATABASE).resolve()}"


def current(out: Path) -> str:
    """Return where MLflow is now: as the environment says, else :func:`own`."""
    return os.environ.get("MLFLOW_TRACKING_URI") or own(out)


def existing(out: Path) -> str | None:
    """Return the current registry; None where it is a file that is not there, and stays so."""
    now = current(out)
    return now if _is_there(now) else None


def shown(out: Path) -> str:
    """Return where MLflow is now, without a password."""
    return f"MLflow at {without_password(current(out))}"


def note(out: Path) -> None:
    """Note the current registry, unless it is the folder's own; call when it has answered."""
    address = without_password(current(out))
    if address != own(out) and address not in _noted(out):
        with (out / FILE).open("a", encoding="utf-8") as file:
            file.write(f"{address}\n")


def everyone(out: Path) -> list[str]:
    """Return the folder's own registry, the current one and those noted, which exist.

    Raises :class:`InputError` for a noted file that is not there: what it refers to is not known.
    """
    now = current(out)
    addresses: Mapping[str, str] = {without_password(now): now}
    found = [one for one in (own(out), now) if _is_there(one)]
    for address in _noted(out):
        known = addresses.get(address, address)  # the environment's has its password
        if not _is_there(known):
            raise InputError(
                f"{known}: runs of {out} were recorded there, and it is gone; restore it, or "
                f"remove its line from {out / FILE}"
            )
        found.append(known)
    return list(dict.fromkeys(found))


def _noted(out: Path) -> list[str]:
    path = out / FILE
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [line.strip() for line in lines if line.strip()]


def _is_there(address: str) -> bool:
    """Whether an SQLite file is there, as asking SQLite for one would make it; True of servers."""
    file, _, _ = address.removeprefix(SQLITE).partition("?")
    return not address.startswith(SQLITE) or Path(file).is_file()


def without_password(address: str) -> str:
    """Return a server's address without a password, a file's for whatever working folder."""
    if address.startswith(SQLITE):
        return f"{SQLITE}{Path(address.removeprefix(SQLITE)).resolve()}"
    signed_in = "//[^/@]*@" if address.startswith("http") else "//[^@]*@"  # a database's may have /
    return re.sub(signed_in, "//", address, count=1)
