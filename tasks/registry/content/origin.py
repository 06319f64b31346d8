"""Where a run came from, under the names of tags that MLflow's interface shows as columns."""

import getpass
from typing import Any

from tasks.registry.content.about import About

EDITED = "+changes"  # ends the commit of an edited source, see mattgs_ops/store/provenance.py


def tags(row: dict[str, Any], about: About) -> dict[str, str]:
    """Return the tags of the columns *Source*, *Version* and *User*; only those that are known."""
    found = {"mlflow.user": _user()}
    if about.command:
        found |= {"mlflow.source.name": about.command, "mlflow.source.type": "LOCAL"}
    git = (row.get("provenance") or {}).get("git")
    if git:
        found["mlflow.source.git.commit"] = str(git).removesuffix(EDITED)
    return found


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user has no name
        return "unknown"
