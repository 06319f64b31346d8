"""Splats on disk: the PLY of the original 3DGS release, byte for byte in layout.

One ``vertex`` element, binary little endian, every property a 32-bit float, in this order::

    x y z  nx ny nz  f_dc_0..2  f_rest_0..44  opacity  scale_0..2  rot_0..3

Normals are zero. ``f_rest`` is channel-major: 15 coefficients of red, then green, then blue.
``opacity`` is the logit, ``scale`` the natural logarithm, ``rot`` the quaternion w x y z, not
necessarily of unit length. Reading also takes files of other trainers that hold the same
properties in another order, lower SH degrees, no normals, or comments; anything else is refused.
"""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from mattgs_ops.errors import InputError
from mattgs_ops.splat.gaussians import SH_REST, Splats

PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz"),
    *(f"f_dc_{i}" for i in range(3)),
    *(f"f_rest_{i}" for i in range(3 * SH_REST)),
    "opacity",
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
)
REQUIRED = tuple(p for p in PROPERTIES if not p.startswith(("n", "f_rest_")))
REST_COUNTS = {0: 0, 9: 3, 24: 8, 45: 15}  # stored f_rest values → coefficients per channel
FLOAT_NAMES = ("float", "float32")
HEADER_LIMIT = 65_536  # bytes; a header that is longer than this is no header of ours
SKIPPED = ("comment", "obj_info")


def write_ply(splats: Splats, path: Path) -> None:
    """Write ``splats`` to ``path``; the file appears whole or not at all."""
    count = splats.means.shape[0]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    lines += [f"property float {name}" for name in PROPERTIES]
    header = "\n".join([*lines, "end_header", ""]).encode("ascii")
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
    partial = path.with_name(path.name + ".part")
    with partial.open("wb") as file:
        file.write(header)
        file.write(table.tobytes())
    partial.replace(path)


def read_ply(path: Path) -> Splats:
    """Read splats; missing SH coefficients become zero.

    Raises :class:`InputError` naming the file, what was expected and what was found.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected a readable PLY file: {error}") from error
    count, names, offset = _parse_header(data, path)
    expected = count * len(names) * 4
    if len(data) - offset != expected:
        raise InputError(
            f"{path}: expected {expected} bytes of vertices after the header "
            f"({count} x {len(names)} floats), found {len(data) - offset}"
        )
    table = np.frombuffer(data, dtype="<f4", offset=offset).reshape(count, len(names))
    column = {name: table[:, i] for i, name in enumerate(names)}
    per_channel = REST_COUNTS[sum(name.startswith("f_rest_") for name in names)]
    rest = np.zeros((count, SH_REST, 3), dtype=np.float32)
    for channel in range(3):
        for k in range(per_channel):
            rest[:, k, channel] = column[f"f_rest_{channel * per_channel + k}"]
    stack = {
        "means": ("x", "y", "z"),
        "log_scales": ("scale_0", "scale_1", "scale_2"),
        "quaternions": ("rot_0", "rot_1", "rot_2", "rot_3"),
        "sh_dc": ("f_dc_0", "f_dc_1", "f_dc_2"),
    }
    arrays = {field: np.stack([column[n] for n in part], 1) for field, part in stack.items()}
    arrays |= {"opacity_logits": column["opacity"], "sh_rest": rest}
    return Splats(**{field: _tensor(array, field, path) for field, array in arrays.items()})


def _tensor(array: NDArray[np.float32], field: str, path: Path) -> torch.Tensor:
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    if bad.any():
        raise InputError(
            f"{path}: expected finite numbers, found NaN or infinity in `{field}` of vertex "
            f"{int(np.argmax(bad))}"
        )
    return torch.from_numpy(np.array(array, dtype=np.float32, order="C"))


def _parse_header(data: bytes, path: Path) -> tuple[int, list[str], int]:
    """Return (vertices, property names, offset of the first vertex)."""
    end = data.find(b"end_header\n", 0, HEADER_LIMIT)
    if not data.startswith(b"ply\n") or end < 0:
        raise InputError(f"{path}: expected a PLY file with splats, found {data[:16]!r}…")
    lines = data[:end].decode("ascii", errors="replace").splitlines()[1:]
    words = [line.split() for line in lines if line.split() and line.split()[0] not in SKIPPED]
    if not words or words[0] != ["format", "binary_little_endian", "1.0"]:
        found = " ".join(words[0]) if words else "nothing"
        raise InputError(f"{path}: expected `format binary_little_endian 1.0`, found `{found}`")
    if len(words) < 2 or words[1][:2] != ["element", "vertex"] or not words[1][-1].isdigit():
        found = " ".join(words[1]) if len(words) > 1 else "nothing"
        raise InputError(f"{path}: expected `element vertex COUNT` first, found `{found}`")
    for line in words[2:]:
        if len(line) != 3 or line[0] != "property" or line[1] not in FLOAT_NAMES:
            raise InputError(f"{path}: expected `property float NAME`, found `{' '.join(line)}`")
    names = [line[2] for line in words[2:]]
    _check_names(names, path)
    return int(words[1][2]), names, end + len(b"end_header\n")


def _check_names(names: list[str], path: Path) -> None:
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        raise InputError(f"{path}: not splats as 3DGS writes them: no property `{missing[0]}`")
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise InputError(f"{path}: property `{doubled[0]}` comes twice")
    rest = [name for name in names if name.startswith("f_rest_")]
    if len(rest) not in REST_COUNTS or set(rest) != {f"f_rest_{i}" for i in range(len(rest))}:
        raise InputError(
            f"{path}: expected 0, 9, 24 or 45 `f_rest_*` properties, found {len(rest)}"
        )
