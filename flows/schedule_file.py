"""What ``mattgs serve`` serves: the deployments of a folder's ``prefect.yaml``, else the project's.

The file is Prefect's own (`prefect deploy` reads it too); here its flows are those of
``flows/scheduled.py``.
"""

import re
from pathlib import Path
from typing import Any

import yaml
from prefect.client.schemas.schedules import CronSchedule
from prefect.exceptions import ParameterTypeError
from pydantic import ValidationError

from flows.scheduled import DEPLOYMENTS, Deployment
from mattgs_ops.errors import InputError

FILE = Path("prefect.yaml")
FLOWS = {one.flow.fn.__name__: one.flow for one in DEPLOYMENTS}
SCHEDULE_KEYS = {"cron", "timezone", "active", "slug"}  # the last one names it for Prefect alone
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
    name = entry.get("name")
    if not isinstance(name, str) or not name:
        raise InputError(f"{where}: `name`: expected one in quotes, found {name!r}")
    return Deployment(
        flow,
        name,
        description=str(entry.get("description", "")),
        settings=settings,
        paused=_whether(entry, "paused", where, default=False),
        **_schedule(entry, where),
    )


def _schedule(entry: dict[str, Any], where: str) -> dict[str, Any]:
    """Return ``cron``, ``timezone`` and ``active`` of the one schedule, checked as Prefect does."""
    if "schedule" in entry:
        raise InputError(f"{where}: `schedule`: expected a list, `schedules`")
    listed = entry.get("schedules") or []
    if not listed:
        return {"cron": None}
    if not isinstance(listed, list) or len(listed) > 1 or not isinstance(listed[0], dict):
        raise InputError(f"{where}: `schedules`: expected one with `cron`, or none")
    one = listed[0]
    unknown = one.keys() - SCHEDULE_KEYS
    if unknown or one.get("cron") is None:
        raise InputError(
            f"{where}: `schedules`: expected one with `cron`, and perhaps `timezone` and `active`, "
            f"found {', '.join(map(str, one))}; `prefect deploy` takes others"
        )
    cron, timezone = str(one["cron"]), one.get("timezone")
    try:
        CronSchedule(cron=cron, timezone=timezone)
    except ValidationError as error:
        reasons = "; ".join(problem["msg"] for problem in error.errors())
        raise InputError(f"{where}: `schedules`: {cron!r}, {timezone!r}: {reasons}") from error
    return {"cron": cron, "timezone": timezone, "active": _whether(one, "active", where, True)}


def _whether(entry: dict[str, Any], key: str, where: str, default: bool) -> bool:
    value = entry.get(key, default)
    if not isinstance(value, bool):
        raise InputError(f"{where}: `{key}`: expected true or false, found {value!r}")
    return value
