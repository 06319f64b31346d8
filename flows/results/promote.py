"""Promote a run to the baseline of its cell, and prove that the registered model loads."""

from pathlib import Path

from flows.services import embedded, registries
from tasks.registry import lookup, promotion


def promote(run: str, out: Path, alias: str) -> str:
    """Promote the run that ``run`` means; return what to print.

    Raises :class:`InputError` when it means no run, several, or one that did not finish.
    """
    embedded.enter_existing(out)
    tracking = registries.current(out)
    found = lookup.find_run(tracking, run)
    address = promotion.promote(tracking, found, alias)
    return f"Promoted {found} to {alias}: {address}"
