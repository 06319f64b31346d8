"""A benchmark's history: a page of all its metrics over runs and commits, and its steps as text."""

from pathlib import Path

from flows.services import embedded, registries
from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_name
from tasks.registry.content import history

FOLDER = "history"


def show_history(benchmark: str, out: Path) -> str:
    """Write the page below ``out``; return the steps, one a line, and where the page is.

    Raises :class:`InputError` when the registry does not know the benchmark, or no run of it ended.
    """
    from reports.history import page

    checked_name(benchmark, "the benchmark's name")
    embedded.enter_existing(out)
    runs = history.runs_of(registries.current(out), benchmark)
    if not runs:
        raise InputError(f"benchmark {benchmark!r} has no experiment that ended yet")
    folder = out / "benchmarks" / benchmark / FOLDER
    built = page.build(runs, folder, title=f"History of {benchmark}")
    lines = [f"History of {benchmark}: {built.summary}"]
    for step in map(page.describe, built.steps):
        change = f"{step['before']} → {step['after']}"
        place = f"first at {step['first']}, last before {step['last']}"
        lines.append(f"{step['kind']:7}  {step['cell']}  {step['metric']}: {change}, {place}")
    return "\n".join([*lines, f"Page: {built.page}"])
