"""Splats in a PLY file as arrays: the layout of the original 3DGS release, read without torch.

One ``vertex`` element, binary little endian, every property a 32-bit float, in this order::

    x y z  nx ny nz  f_dc_0..2  f_rest_0..44  opacity  scale_0..2  rot_0..3

Normals are zero. ``f_rest`` is channel-major: 15 coefficients of red, then green, then blue.
``opacity`` is the logit, ``scale`` the natural logarithm, ``rot`` the quaternion w x y z, not
necessarily of unit length. Reading also takes files of other trainers that hold the same
properties in another order, number type or byte order, lower SH degrees, no normals, or comments;
anything else is refused.
"""

from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from mattgs_ops.errors import InputError
from mattgs_ops.splat.harmonics import SH_REST

PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz"),
    *(f"f_dc_{i}" for i in range(3)),
    *(f"f_rest_{i}" for i in range(3 * SH_REST)),
    "opacity",
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
)
REQUIRED = tuple(p for p in PROPERTIES if not p.startswith(("n", "f_rest_")))
HEADER_END = b"end_header"
LONGEST_HEADER = 1 << 20  # bytes; beyond it there is no header
REST_COUNTS = {0: 0, 9: 3, 24: 8, 45: 15}  # stored f_rest values → coefficients per channel


def read_arrays(path: Path) -> dict[str, NDArray[np.float32]]:
    """Read what ``Splats`` holds, by its fields' names; missing SH coefficients become zero.

    Raises :class:`InputError` naming the file, what was expected and what was found.
    """
    vertices = _vertices(path)
    names = list(vertices.dtype.names or ())
    _check_names(names, path)
    column = {name: np.asarray(vertices[name], dtype=np.float32) for name in names}
    per_channel = REST_COUNTS[sum(name.startswith("f_rest_") for name in names)]
    rest = np.zeros((len(vertices), SH_REST, 3), dtype=np.float32)
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
    for field, array in arrays.items():
        _check_finite(array, field, path)
    return arrays


def _vertices(path: Path) -> NDArray[Any]:
    """Return the rows of the element ``vertex`` as a structured array."""
    try:
        with path.open("rb") as file:
            header = file.read(LONGEST_HEADER).partition(HEADER_END)[0]
            if any(line.split()[:2] == [b"format", b"ascii"] for line in header.splitlines()):
                raise InputError(f"{path}: expected a binary PLY file, found one in ascii")
            file.seek(0)
            source = file if header.isascii() else _with_ascii_header(header, file)
            vertices: NDArray[Any] = PlyData.read(source)["vertex"].data
            left = len(source.read())
    # numpy's own errors come from sizes in the header that the file cannot hold
    except (PlyParseError, OSError, KeyError, ValueError, OverflowError, MemoryError) as error:
        raise InputError(f"{path}: expected a PLY file with splats: {error}") from error
    if left:
        raise InputError(
            f"{path}: expected the file to end with its last element, {left} bytes left"
        )
    names = vertices.dtype.names or ()
    wrong = [name for name in names if vertices.dtype[name].kind not in "fiu"]
    if wrong:
        raise InputError(f"{path}: expected one number a property, found a list in `{wrong[0]}`")
    return vertices


def _with_ascii_header(header: bytes, file: BinaryIO) -> BytesIO:
    """Return the file with a question mark for each byte of a comment that plyfile cannot read."""
    plain = header.decode("ascii", errors="replace").replace("\N{REPLACEMENT CHARACTER}", "?")
    return BytesIO(plain.encode() + file.read()[len(header) :])


def _check_finite(array: NDArray[np.float32], field: str, path: Path) -> None:
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    if bad.any():
        raise InputError(
            f"{path}: expected finite numbers, found NaN or infinity in `{field}` of vertex "
            f"{int(np.argmax(bad))}"
        )


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
