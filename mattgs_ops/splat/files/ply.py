"""Splats on disk: the PLY of the original 3DGS release, byte for byte in layout.

``ply_arrays`` says what the layout is, and which other files are read.
"""

from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData, PlyElement

from mattgs_ops.splat.files.ply_arrays import PROPERTIES, read_arrays
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.harmonics import SH_REST
from mattgs_ops.whole_file import written_whole


def write_ply(splats: Splats, path: Path) -> None:
    """Write ``splats`` to ``path``; the file appears whole or not at all."""
    count = splats.means.shape[0]
    rest = splats.sh_rest.transpose(1, 2).reshape(count, 3 * SH_REST)  # [N, 3, 15] → channel-major
    columns = [
        splats.means,
        torch.zeros_like(splats.means),
        splats.sh_dc,
        rest,
        splats.opacity_logits[:, None],
        splats.log_scales,
        splats.quaternions,
    ]
    table = torch.cat([c.detach() for c in columns], dim=1).numpy().astype("<f4", copy=False)
    vertices = np.ascontiguousarray(table).view([(name, "<f4") for name in PROPERTIES])[:, 0]
    with written_whole(path) as partial:
        PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(partial))


def read_ply(path: Path) -> Splats:
    """Read splats; missing SH coefficients become zero.

    Raises :class:`InputError` naming the file, what was expected and what was found.
    """
    arrays = read_arrays(path)
    return Splats(
        **{
            field: torch.from_numpy(np.array(array, dtype=np.float32, order="C"))
            for field, array in arrays.items()
        }
    )
