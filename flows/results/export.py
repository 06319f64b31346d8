"""Write a run's splats in the format of a viewer."""

import tempfile
from pathlib import Path

from flows.results.splats_of import splats_of
from mattgs_ops.errors import InputError
from mattgs_ops.naming import slug


def export(what: str, form: str, file: Path | None, out: Path) -> str:
    """Export the splats that ``what`` names; return what to print.

    Without ``file`` it goes to ``exports`` below ``out``, named after the run. Raises
    :class:`InputError` for an unknown format or run, and where the file cannot be written.
    """
    from mattgs_ops.splat.files import export as formats
    from mattgs_ops.splat.files.ply import read_ply

    ending = formats.suffix(form)
    with tempfile.TemporaryDirectory(prefix="mattgs-export-") as folder:
        source = splats_of(what, out, Path(folder))
        path = file or out / "exports" / f"{slug(source.name)}{ending}"
        if path.resolve() == source.splats.resolve():
            raise InputError(f"{path}: expected another file than the one that is read")
        splats = read_ply(source.splats)
        before = source.splats.stat().st_size
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        formats.export(splats, form, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error
    size = path.stat().st_size
    return f"Exported {len(splats):,} splats, {size:,} bytes of {before:,}: {path}"
