"""Splats as MLflow's pyfunc flavour loads them: a model whose input is cameras, its output images.

A promoted model carries a copy of this module (:mod:`tasks.registry.model`). A camera is one row of
a table, or one mapping, in the project's convention
(``mattgs_ops/capture/camera.py``)::

    {"width": 320, "height": 240, "fx": 280.0, "fy": 280.0, "cx": 160.0, "cy": 120.0,
     "rotation": [[…], […], […]], "translation": [x, y, z]}
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.errors import InputError

SPLATS, SETTINGS = "splats.ply", "model.json"
NUMBERS = ("fx", "fy", "cx", "cy")
PIXELS = ("width", "height")
COLUMNS = (*PIXELS, *NUMBERS, "rotation", "translation")


class SplatModel:
    """Renders views of one set of splats over one background colour."""

    def __init__(self, folder: Path) -> None:
        import json

        from mattgs_ops.splat.files.ply import read_ply

        self._splats = read_ply(folder / SPLATS)
        settings = json.loads((folder / SETTINGS).read_text(encoding="utf-8"))
        self._background = tuple(settings["background"])

    def predict(
        self, model_input: Any, params: Mapping[str, Any] | None = None
    ) -> list[NDArray[np.uint8]]:
        """Return one image [H, W, 3] uint8 sRGB per camera.

        ``model_input`` is a data frame, a mapping of one camera, or a list of such. ``params`` may
        hold ``threads``. Raises :class:`InputError` naming what a camera lacks.
        """
        from mattgs_ops.splat.render import render_view

        threads = int((params or {}).get("threads", 1))
        background = self._background
        return [
            render_view(self._splats, camera, background, threads=threads)
            for camera in map(camera_of, _mappings(model_input))
        ]


def _load_pyfunc(path: str) -> SplatModel:
    """MLflow's entry; ``path`` is the folder of the model's data."""
    return SplatModel(Path(path))


def camera_of(row: Mapping[str, Any]) -> Camera:
    """Make a camera of one row; raises :class:`InputError` naming what is missing or wrong."""
    missing = [name for name in COLUMNS if row.get(name) is None]
    if missing:
        raise InputError(f"camera: expected {', '.join(COLUMNS)}; found no {', '.join(missing)}")
    rotation = _array(row["rotation"], "rotation", (3, 3))
    translation = _array(row["translation"], "translation", (3,))
    width, height = (int(row[name]) for name in PIXELS)
    if min(width, height) < 1:
        raise InputError(f"camera: expected a size of pixels, found {width} x {height}")
    lens = Intrinsics(width, height, *(float(row[name]) for name in NUMBERS))
    return Camera(lens, rotation, translation)


def row_of(camera: Camera) -> dict[str, Any]:
    """Turn a camera into the row that :func:`camera_of` reads."""
    return {
        **vars(camera.intrinsics),
        "rotation": camera.rotation.tolist(),
        "translation": camera.translation.tolist(),
    }


def _mappings(model_input: Any) -> Sequence[Mapping[str, Any]]:
    if isinstance(model_input, Mapping):
        return [model_input]
    if hasattr(model_input, "to_dict"):  # a data frame
        rows: list[Mapping[str, Any]] = model_input.to_dict("records")
        return rows
    return list(model_input)


def _array(values: Any, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    try:
        rows = [list(part) for part in values] if len(shape) == 2 else values
        array = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"camera: `{name}`: expected numbers: {error}") from error
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"camera: `{name}`: expected finite {shape}, found shape {array.shape}")
    return array
