"""What another program left: found, read, checked, and kept as ``splats.ply``."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.splat.files.ply import read_ply, write_ply
from mattgs_ops.splat.files.splat_file import read_splat
from mattgs_ops.splat.files.spz_file import read_spz
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.trainer import TrainerConfig, fill

READERS = {".ply": read_ply, ".splat": read_splat, ".spz": read_spz}


def take_splats(
    name: str, trainer: TrainerConfig, output: Path, values: Mapping[str, object], target: Path
) -> Splats:
    """Read the splats below ``output`` and keep them as ``target``.

    A PLY stays byte for byte what the program wrote, other formats are converted. Raises
    :class:`StageError` when there are none, or they are no splats.
    """
    path = _find(name, trainer, output, values)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise StageError(
            f"trainer {name}: expected {', '.join(READERS)}, found {path.relative_to(output)}"
        )
    try:
        splats = reader(path)
    except InputError as error:
        # the folder is a temporary one: its path says nothing
        text = str(error).replace(str(path), str(path.relative_to(output)))
        raise StageError(f"trainer {name}: its splats cannot be read: {text}") from error
    if not len(splats):
        raise StageError(f"trainer {name}: {path.relative_to(output)} holds no splat")
    if path.suffix.lower() == ".ply":
        shutil.copyfile(path, target)
    else:
        write_ply(splats, target)
    return splats


def _find(name: str, trainer: TrainerConfig, output: Path, values: Mapping[str, object]) -> Path:
    pattern = None if trainer.result is None else fill(trainer.result, values)
    inside = output.resolve()
    every = [p for p in sorted(output.rglob("*")) if p.is_file()]
    if pattern is None:
        found = [path for path in every if path.suffix.lower() in READERS]
    else:
        found = [path for path in sorted(output.glob(pattern)) if path.is_file()]
    found = [path for path in found if path.resolve().is_relative_to(inside)]
    if len(found) == 1:
        return found[0]
    wanted = "a .ply, .splat or .spz" if pattern is None else f"`{pattern}`"
    if found:
        names = ", ".join(str(path.relative_to(output)) for path in found[:4])
        raise StageError(
            f"trainer {name}: it wrote {len(found)} files that are {wanted}: {names}; name one "
            "in `result`"
        )
    names = ", ".join(str(path.relative_to(output)) for path in every[:4]) or "nothing"
    raise StageError(f"trainer {name}: it ended well but wrote no file that is {wanted}: {names}")
