"""The splats that a command names: a run's, from the registry, or a PLY file's."""

from dataclasses import dataclass
from pathlib import Path

from flows.services import embedded, registries
from mattgs_ops.errors import InputError
from tasks.registry import lookup, summary


@dataclass(frozen=True)
class SplatSource:
    """``name`` for people and files; ``files`` is the folder of a run's artifacts, if it is one."""

    name: str
    splats: Path
    files: Path | None = None


def splats_of(what: str, out: Path, into: Path) -> SplatSource:
    """Find what ``what`` names; a server's files are downloaded below ``into``.

    Raises :class:`InputError` when it is neither a file nor a run that trained splats.
    """
    if Path(what).is_file():
        return SplatSource(Path(what).stem, Path(what))
    if what.endswith(".ply"):
        raise InputError(f"{what}: expected a PLY file, found none")
    embedded.enter_existing(out)
    tracking = registries.current(out)
    found = lookup.find_run(tracking, what)
    files = summary.run_files(tracking, found.run_id, into)
    splats = files / "splats.ply"
    if not splats.is_file():
        raise InputError(f"run {found}: expected splats, found none; did its training finish?")
    name = f"{found.benchmark} {found.name} {found.run_id[:8]}"
    return SplatSource(name, splats, files)
