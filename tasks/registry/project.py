"""Whose benchmark it is, on a server that several people share.

The environment variable ``MATTGS_PROJECT`` holds a user's or a project's name. It stands before the
names of experiments (``anna/quick``) and of registered models (``anna.quick.rover…``), so two
users' `quick` stay apart. It is read where names are made: set it where ``MLFLOW_TRACKING_URI`` is
set, and all commands agree.
"""

import os

from mattgs_ops.naming import checked_name

VARIABLE = "MATTGS_PROJECT"


def project() -> str | None:
    """Return the project's name, None where none is set; raises :class:`InputError` if it is bad.

    A name has the form that captures' names have: no slash and no blank.
    """
    name = os.environ.get(VARIABLE)
    return checked_name(name, VARIABLE) if name else None


def experiment_name(benchmark: str) -> str:
    """Return the name of the benchmark's MLflow experiment."""
    name = project()
    return f"{name}/{benchmark}" if name else benchmark


def benchmark_name(experiment: str) -> str:
    """Return the benchmark of an experiment; one of another project keeps its whole name."""
    name = project()
    return experiment.removeprefix(f"{name}/") if name else experiment


def is_ours(experiment: str) -> bool:
    """Whether an experiment belongs to the project; without a project all do."""
    name = project()
    return name is None or experiment.startswith(f"{name}/")
