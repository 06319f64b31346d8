"""3D Gaussian Splatting on the CPU: parameters, rasteriser, losses.

``gaussians`` holds the parameters, ``rasterize`` and ``ssim`` call the compiled engine,
``attention`` is the paper's map, ``exposure`` a change of colour per photo, ``photos`` the training
images. ``training/`` optimises, ``files/`` reads and writes splat formats, ``gsplat_interface/`` is
the engine as a torch function. Public face: ``training.train.train``, ``render.render_view``, and
for those who bring their own loss ``from mattgs_ops.splat import rasterization``.
"""

import importlib
from typing import Any

PUBLIC = {"rasterization": "mattgs_ops.splat.gsplat_interface.rasterization"}


def __getattr__(name: str) -> Any:
    """Import a public function when it is first used: other modules here do not need torch."""
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(PUBLIC[name]), name)
