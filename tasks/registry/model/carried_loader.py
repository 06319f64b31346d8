"""MLflow's entry to a promoted model. This file travels with the model, as a package of its own.

Beside it lie ``splat_model.py`` and, in ``carried/``, the part of this project that renders splats,
with its kernels compiled for the machine that promoted the run. Where the project is installed, its
own code is used: nothing of an installed package is hidden by a part of it.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

CARRIED = Path(__file__).with_name("carried")


def _load_pyfunc(path: str) -> Any:
    """Return the model; ``path`` is the folder of its data."""
    return _model_class()(Path(path))


def _model_class() -> Any:
    if find_spec("mattgs_ops") is not None:
        try:
            from tasks.splat_model import SplatModel
        except ModuleNotFoundError:  # what is there was carried by another model
            pass
        else:
            return SplatModel
    sys.path.append(str(CARRIED))
    try:
        import_module("mattgs_ops.splat._engine")  # fails here, where it can be explained
        return import_module(f"{__name__}.splat_model").SplatModel
    except ImportError as error:
        kernels = ", ".join(path.name for path in CARRIED.rglob("_engine*.so"))
        raise ImportError(
            f"this model carries kernels that were compiled for one platform ({kernels}), and they "
            f"do not load here: {error}; install the project mattgs-bench from its source instead"
        ) from error
