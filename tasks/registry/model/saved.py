"""A promoted run's splats as a folder of MLflow's pyfunc flavour.

The model carries the code that renders it and names, with versions, what that code imports from
PyPI. Its signature says what a camera is; its input example is one that sees the splats.
"""

import ast
import json
import shutil
import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

import mattgs_ops
from mattgs_ops.store.code_version import ROOT, dependencies
from tasks.registry.model import carried_loader

LOADER = "mattgs_splat_loader"
RENDERER = "tasks.splat_model"
EXAMPLE = {
    "width": 320, "height": 240, "fx": 280.0, "fy": 280.0, "cx": 160.0, "cy": 120.0,
    "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    "translation": [0.0, 0.0, 4.0],
}  # fmt: skip


def save(
    folder: Path,
    splats: Path,
    settings: Mapping[str, Any],
    camera: Mapping[str, Any] | None,
    identity: Mapping[str, str],
) -> None:
    """Write the model into ``folder``, which must not exist.

    ``settings`` are what ``tasks/splat_model.py`` reads beside the splats, ``camera`` the input
    example (None: :data:`EXAMPLE`), ``identity`` MLflow's ``model_id`` and ``run_id``.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MLflow's import warns of MLflow's own type hints
        import mlflow.pyfunc
        from mlflow.models import Model

    example = dict(camera or EXAMPLE)
    with tempfile.TemporaryDirectory(prefix="mattgs-model-") as place:
        data, code = Path(place) / "data", Path(place) / LOADER
        data.mkdir()
        shutil.copyfile(splats, data / "splats.ply")
        (data / "model.json").write_text(json.dumps(dict(settings)) + "\n", encoding="utf-8")
        carry_code(code)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that whole numbers cannot be missing in MLflow
            mlflow.pyfunc.save_model(
                folder,
                mlflow_model=Model(**identity),
                loader_module=LOADER,
                data_path=str(data),
                code_paths=[str(code)],
                pip_requirements=requirements(),
                signature=signature(),
                input_example=_table(example),
            )


def signature() -> Any:
    """Return the model's signature: a table of cameras in, one image [H, W, 3] uint8 each out."""
    import numpy as np
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, DataType, ParamSchema, ParamSpec, Schema, TensorSpec
    from mlflow.types.schema import Array

    numbers = [ColSpec(DataType.long, name) for name in ("width", "height")]
    numbers += [ColSpec(DataType.double, name) for name in ("fx", "fy", "cx", "cy")]
    vector = Array(DataType.double)
    poses = [ColSpec(Array(vector), "rotation"), ColSpec(vector, "translation")]
    return ModelSignature(
        inputs=Schema([*numbers, *poses]),
        outputs=Schema([TensorSpec(np.dtype("uint8"), (-1, -1, -1, 3))]),
        params=ParamSchema([ParamSpec("threads", DataType.long, 1)]),
    )


def carry_code(folder: Path) -> None:
    """Write the loader, the renderer and all of the project that it imports into ``folder``."""
    sources, _ = dependencies([RENDERER])
    for source in sources:
        below = source.relative_to(ROOT)
        own = below.parts[0] == mattgs_ops.__name__
        target = folder / "carried" / below if own else folder / below.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    for kernels in _engine():
        shutil.copyfile(kernels, folder / "carried" / "mattgs_ops" / "splat" / kernels.name)
    shutil.copyfile(carried_loader.__file__, folder / "__init__.py")


def _engine() -> Iterator[Path]:
    from mattgs_ops.splat import _engine as engine

    yield Path(str(engine.__file__))


def requirements() -> list[str]:
    """Return what the carried code needs from PyPI, in the versions of this machine."""
    sources, _ = dependencies([RENDERER])
    distributions = packages_distributions()
    names = {name for source in sources for name in _imported(source)} - set(
        sys.stdlib_module_names
    )
    found = {
        distributions[name][0]
        for name in names
        if name in distributions and name != mattgs_ops.__name__
    }
    # a local version, as of a CPU build, is on no index
    return sorted(f"{name}=={version(name).partition('+')[0]}" for name in {*found, "mlflow"})


def _imported(path: Path) -> Iterator[str]:
    """Yield the top-level names that a file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.partition(".")[0]


def _table(camera: Mapping[str, Any]) -> Any:
    import pandas

    return pandas.DataFrame([dict(camera)])
