"""A message when a run has failed: to a notification block of Prefect's, or to a web address.

``run.notify`` is ``TYPE/NAME`` of a block that was saved on the server, such as
``slack-webhook/lab`` (docs/prefect.md has e-mail, too), or a URL that takes a POST with JSON. Only
the outermost flow run sends one, so a night that fails is one message. A message that cannot be
sent costs a warning, never the run.
"""

import json
import logging
import urllib.request
from typing import Any, Protocol, cast

from prefect import Flow
from prefect.blocks.core import Block
from prefect.client.schemas.objects import FlowRun, State
from prefect.flows import FlowStateHook
from prefect.utilities.urls import url_for

from mattgs_ops.errors import InputError

SEND_SECONDS = 20.0  # a web address has so long to answer
WEB = ("http://", "https://")

Hook = FlowStateHook[..., Any]


class _Notifies(Protocol):
    def notify(self, body: str, subject: str | None = None) -> object: ...


def check(target: str | None) -> None:
    """Raise :class:`InputError` where ``target`` names a block that the server does not have."""
    if target is not None and not target.startswith(WEB):
        _block(target)


def failure_hook(target: str | None) -> list[Hook]:
    """Return the hooks, for ``on_failure`` and ``on_crashed``, that send to ``target``."""
    if target is None:
        return []

    def notify(flow: Flow[..., Any], flow_run: FlowRun, state: "State[Any]") -> None:
        send(target, flow.name, flow_run, state)

    return [notify]


def parameters_hook(flow: Flow[..., Any], flow_run: FlowRun, state: "State[Any]") -> None:
    """Send to where the form of a deployment's run says (``notify``)."""
    settings = (flow_run.parameters or {}).get("settings")
    target = settings.get("notify") if isinstance(settings, dict) else None
    if target:
        send(str(target), flow.name, flow_run, state)


def send(target: str, flow: str, run: FlowRun, state: "State[Any]") -> None:
    """Send the message of a failed run, unless another flow called it."""
    if run.parent_task_run_id is not None:
        return
    address = url_for(run) or ""
    subject = f"MATT-GS Bench: {flow} {run.name}: {state.name or state.type.value}"
    text = "\n".join(part for part in (state.message or "", address) if part)
    try:
        if target.startswith(WEB):
            _post(target, {"text": f"{subject}\n{text}", "flow": flow, "run": str(run.id)})
        else:
            _block(target).notify(text or subject, subject)
    except Exception as error:  # whatever the block, the server or the network raise
        logging.getLogger("mattgs").warning("no message was sent to %s: %s", _named(target), error)


def _post(target: str, content: dict[str, str]) -> None:
    """POST JSON; Slack, Mattermost and Teams print the key ``text``."""
    request = urllib.request.Request(
        target,
        data=json.dumps(content).encode(),
        headers={"Content-Type": "application/json"},
        method="POST",
    )
    with urllib.request.urlopen(request, timeout=SEND_SECONDS):
        pass


def _block(target: str) -> _Notifies:
    try:
        block = Block.load(target)
    except ValueError as error:
        raise InputError(f"run.notify: the Prefect server has no block {target!r}") from error
    if not hasattr(block, "notify"):
        raise InputError(
            f"run.notify: expected a notification block, found {target!r}, a {type(block).__name__}"
        )
    return cast(_Notifies, block)


def _named(target: str) -> str:
    """Return a target without the part of a URL that may be a secret."""
    return "/".join(target.split("/")[:3]) if target.startswith(WEB) else target
