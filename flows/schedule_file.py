"""What ``mattgs serve`` serves: the deployments of a folder's ``prefect.yaml``, else the project's.

The file is Prefect's own (`prefect deploy` reads it too); here its flows are those of
``flows/scheduled.py``.
"""

import re
from pathlib import Path
from typing import Any

import yaml
from prefect.exceptions import ParameterTypeError

from flows.scheduled import DEPLOYMENTS, Deployment
from mattgs_ops.errors import InputError

FILE = Path("prefect.yaml")
FLOWS = {one.flow.fn.__name__: one.flow for one in DEPLOYMENTS}
ENTRYPOINT = re.compile(r"(?:flows\.scheduled\.|flows/scheduled\.py:)(\w+)")


def deployments(file: Path = FILE) -> tuple[Deployment, ...]:
    """Return the deployments of ``file``; without one :data:`DEPLOYMENTS`.

    Raises :class:`InputError` naming the deployment and what was expected.
    """
    if not file.is_file():
        return DEPLOYMENTS
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{file}: expected a readable YAML file: {error}") from error
    entries = data.get("deployments") if isinstance(data, dict) else None
    if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
        raise InputError(f"{file}: expected a list `deployments`, found {entries!r}")
    return tuple(_deployment(entry, f"{file}: {entry.get('name')}") for entry in entries)


def _deployment(entry: dict[str, Any], where: str) -> Deployment:
    found = ENTRYPOINT.fullmatch(str(entry.get("entrypoint")))
    if found is None or found[1] not in FLOWS:
        names = ", ".join(f"flows.scheduled.{name}" for name in FLOWS)
        raise InputError(
            f"{where}: `entrypoint`: expected one of {names}, found {entry.get('entrypoint')!r}; "
            "`prefect deploy` takes flows of your own"
        )
    flow = FLOWS[found[1]]
    try:
        settings = flow.validate_parameters(entry.get("parameters") or {})["settings"]
    except (ParameterTypeError, TypeError) as error:
        raise InputError(f"{where}: `parameters`: {error}") from error
    crons = [one.get("cron") for one in entry.get("schedules") or [] if isinstance(one, dict)]
    if len(crons) > 1 or None in crons:
        raise InputError(f"{where}: `schedules`: expected one with `cron`, or none")
    cron = str(crons[0]) if crons else None
    return Deployment(
        flow, str(entry.get("name")), cron, str(entry.get("description", "")), settings
    )
