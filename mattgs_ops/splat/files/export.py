"""Splats in the formats of viewers: one entry for all of them.

========== ===================================================== ======================
``ply``    the original 3DGS release's (:mod:`ply`)              exact
``splat``  antimatter15's, 32 bytes a splat (:mod:`splat_file`)  no view dependence
``spz``    Niantic's, version 3 (:mod:`spz_file`)                8 to 24 bits a number
``compressed-ply``  PlayCanvas' (:mod:`compressed_ply`)          8 to 11 bits a number
========== ===================================================== ======================
"""

from collections.abc import Callable
from pathlib import Path

from mattgs_ops.errors import InputError
from mattgs_ops.splat.files.compressed_ply import write_compressed_ply
from mattgs_ops.splat.files.ply import write_ply
from mattgs_ops.splat.files.splat_file import write_splat
from mattgs_ops.splat.files.spz_file import write_spz
from mattgs_ops.splat.gaussians import Splats

Writer = Callable[[Splats, Path], None]
WRITERS: dict[str, tuple[str, Writer]] = {
    "ply": (".ply", write_ply),
    "splat": (".splat", write_splat),
    "spz": (".spz", write_spz),
    "compressed-ply": (".compressed.ply", write_compressed_ply),
}


def export(splats: Splats, form: str, path: Path) -> None:
    """Write ``splats`` to ``path``, whole or not at all.

    Raises :class:`InputError` for an unknown format, and for no splats at all.
    """
    if form not in WRITERS:
        raise InputError(f"format {form!r}: expected one of {', '.join(WRITERS)}")
    if not len(splats):
        raise InputError(f"{path}: expected at least one splat to export, found none")
    WRITERS[form][1](splats, path)


def suffix(form: str) -> str:
    """Return how files of a format end; raises :class:`InputError` for an unknown one."""
    if form not in WRITERS:
        raise InputError(f"format {form!r}: expected one of {', '.join(WRITERS)}")
    return WRITERS[form][0]
