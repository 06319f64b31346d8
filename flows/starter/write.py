"""Write ``benchmark.toml``, a workflow and a schedule for the captures of a folder."""

import json
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from itertools import count
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from mattgs_ops.capture.formats import colmap, nerfstudio
from mattgs_ops.capture.photos import SUFFIXES
from mattgs_ops.capture.source import IMAGES, MASKS
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError
from mattgs_ops.naming import capture_name, checked_name

TEMPLATES = Path(__file__).with_name("templates")
BENCHMARK, WORKFLOW, SCHEDULE = "benchmark.toml", ".github/workflows/mattgs.yml", "prefect.yaml"
PHOTO_FOLDERS = ("photos", "images")  # looked for where none is named
FEWEST_PHOTOS = 3  # that structure-from-motion needs
FALLBACK = "rover"  # bundled: the files run before there are photos
GIT_SECONDS = 10.0
# Where the package was not installed from a repository that others reach
SOURCE_VARIABLE = "${{ vars.MATTGS_SOURCE }}"


@dataclass(frozen=True)
class Written:
    """The files, and sentences on what to do next."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]


def write(folder: Path, photos: Path | None = None, name: str | None = None) -> Written:
    """Write the files into ``folder``.

    ``photos`` is a folder of photos of one object, or of folders with one object each; by default
    ``photos/`` or ``images/``. Raises :class:`InputError`, before anything is written, where a
    file is there already, and for a folder without photos.
    """
    benchmark = checked_name(name or capture_name(folder.resolve().name), "--name")
    texts = {
        BENCHMARK: _benchmark(folder, photos, benchmark),
        WORKFLOW: _template("workflow.yml", NAME=benchmark, SOURCE=json.dumps(source())),
        SCHEDULE: _template("prefect.yaml", NAME=benchmark),
    }
    there = [file for file in texts if (folder / file).exists()]
    if there:
        raise InputError(
            f"{folder}: expected none of the files that are written, found {', '.join(there)}; "
            "move them away, or call this in another folder"
        )
    captures = _checked(texts[BENCHMARK], folder)
    for file, text in texts.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return Written(tuple(folder / file for file in texts), _notes(captures))


def _checked(text: str, folder: Path) -> Sequence[Any]:
    """Return the captures of a benchmark's text, read as it will be; raises what reading raises."""
    folder.mkdir(parents=True, exist_ok=True)  # paths are relative to it
    with NamedTemporaryFile("w", suffix=".toml", dir=folder, encoding="utf-8") as file:
        file.write(text)
        file.flush()
        return load_toml(Path(file.name)).captures


def _notes(captures: Sequence[Any]) -> tuple[str, ...]:
    notes = []
    if captures[0].path is None:
        notes.append(
            f"No photos were found in {' or '.join(PHOTO_FOLDERS)}: the bundled capture "
            f"{FALLBACK!r} stands in {BENCHMARK} until you name yours."
        )
    if source() == SOURCE_VARIABLE:
        notes.append(
            "The workflow installs from the repository variable MATTGS_SOURCE: set it to what you "
            "give pip, for example git+https://HOST/OWNER/REPOSITORY@COMMIT."
        )
    return tuple(notes)


def _benchmark(folder: Path, photos: Path | None, name: str) -> str:
    found = _captures(folder, photos)
    wanted = [_capture_name(path, name, alone=len(found) == 1) for path in found]
    paths = [json.dumps(_relative(path, folder), ensure_ascii=False) for path in found]
    tables = [
        f'[[captures]]\nname = "{own}"\npath = {path}\n'
        for own, path in zip(_different(wanted), paths, strict=True)
    ] or [f'[[captures]]\nname = "{FALLBACK}"    # bundled; name your own photos instead\n']
    return _template("benchmark.toml", NAME=name, CAPTURES="\n".join(tables))


def _different(names: Sequence[str]) -> list[str]:
    """Add -2, -3 and so on to names that were there before."""
    out: list[str] = []
    for name in names:
        numbered = (f"{name}-{number}" for number in count(2))
        out.append(name if name not in out else next(n for n in numbered if n not in out))
    return out


def _capture_name(photos: Path, benchmark: str, *, alone: bool) -> str:
    """Name a capture after its folder; a folder called `photos` says nothing."""
    unnamed = alone and photos.name in PHOTO_FOLDERS
    return benchmark if unnamed else capture_name(photos.name)


def _captures(folder: Path, photos: Path | None) -> list[Path]:
    """Return the folders of photos of one object each; none where none was named or found."""
    if photos is not None:
        found = _objects(photos)
        if not found:
            raise InputError(
                f"{photos}: expected at least {FEWEST_PHOTOS} photos, or folders of them, "
                "found neither"
            )
        return found
    if _is_whole(folder):
        return [folder]
    places = (folder / name for name in PHOTO_FOLDERS)
    return next((found for place in places if (found := _objects(place))), [])


def _objects(folder: Path) -> list[Path]:
    """Return ``folder`` where it is one capture, else those folders below it that are one each."""
    if _is_whole(folder) or _has_photos(folder):
        return [folder]
    below = sorted(folder.iterdir()) if folder.is_dir() else []
    shown = [path for path in below if not path.name.startswith(".")]
    return [path for path in shown if _is_whole(path) or _has_photos(path)]


def _is_whole(folder: Path) -> bool:
    """Whether poses or masks lie beside photos, which belong to one capture."""
    if not folder.is_dir():
        return False
    beside = (folder / IMAGES).is_dir() and (folder / MASKS).is_dir()
    return beside or nerfstudio.is_there(folder) or colmap.model_folder(folder) is not None


def _has_photos(folder: Path) -> bool:
    if not folder.is_dir() or folder.name.lower() == MASKS:
        return False
    count = sum(path.suffix.lower() in SUFFIXES for path in folder.iterdir())
    return count >= FEWEST_PHOTOS


def _relative(path: Path, folder: Path) -> str:
    """Return a path relative to the benchmark's file where it lies beside it."""
    absolute, base = path.resolve(), folder.resolve()
    return str(absolute.relative_to(base) if absolute.is_relative_to(base) else absolute)


def source() -> str:
    """Return what a machine elsewhere installs this project from, as pip takes it."""
    try:
        direct = json.loads(distribution("mattgs-bench").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        return SOURCE_VARIABLE
    url, vcs = str(direct.get("url", "")), direct.get("vcs_info")
    if vcs is not None:
        return f"mattgs-bench @ {vcs['vcs']}+{url}@{vcs['commit_id']}"
    if url.startswith("file://"):
        folder = url.removeprefix("file://")
        remote, commit = (
            _git(folder, "remote", "get-url", "origin"),
            _git(folder, "rev-parse", "HEAD"),
        )
        if remote.startswith("https://") and commit:
            return f"mattgs-bench @ git+{remote}@{commit}"
    return SOURCE_VARIABLE


def _git(folder: str, *arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", folder, *arguments],
            capture_output=True, text=True, timeout=GIT_SECONDS, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _template(file: str, **values: str) -> str:
    text = (TEMPLATES / file).read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return text
