"""What code a stage depends on, as a digest.

The digest covers the stage's modules, everything in ``mattgs_ops`` that they import (followed
through the source, imports inside functions included), the sources of compiled modules among
them, and the versions of the numeric libraries that are used. Comments, docstrings
and formatting do not count. Sources are read at each call: a digest must name the code that a
stage's fresh process is about to run.
"""

import ast
import hashlib
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from threading import Lock

from mattgs_ops.errors import InputError
from mattgs_ops.store.digests import file_digest, json_digest
from mattgs_ops.store.user_cache import KeptValues

ROOT = Path(__file__).resolve().parents[2]  # holds the package mattgs_ops and its neighbours
PACKAGE = "mattgs_ops"
# Compiled module → folder of its sources
COMPILED = {
    "mattgs_ops.splat._engine": Path("mattgs_ops/splat/_kernels"),
    "mattgs_ops.sfm.colmap._descriptors": Path("mattgs_ops/sfm/colmap/_kernels"),
}
# Module → a file that it computes with
WEIGHTS = {
    "mattgs_ops.segment.outline.refine": Path("mattgs_ops/bundled/segmenter/outline-int8.onnx"),
}
# Import name → distribution, of libraries whose version can change a result.
LIBRARIES = {
    "cv2": "opencv-contrib-python-headless",
    "numpy": "numpy",
    "onnxruntime": "onnxruntime",
    "PIL": "pillow",
    "pycolmap": "pycolmap",
    "scipy": "scipy",
    "skimage": "scikit-image",
    "torch": "torch",
}
# A package stands for all of its modules: a stage may run one of them in a process of its own.
STAGES: dict[str, tuple[str, ...]] = {
    "prepare": ("mattgs_ops.capture.prepare",),
    "segment": ("mattgs_ops.segment.infer",),
    "sfm": ("mattgs_ops.sfm",),
    "agree": ("mattgs_ops.object_masks.cross_view",),
    "train": ("mattgs_ops.splat.training.train",),
    "evaluate": ("mattgs_ops.score.evaluate",),
    "measure": ("mattgs_ops.score.speed", "mattgs_ops.timing.calibration"),
}
PARSED_BY = 1  # raised when `_parse` finds something else in the same file
KEPT = KeptValues("sources")
PARSING = Lock()
PARSE_TRIES = 5  # beside other libraries' threads that parse
TRUTH = ("mattgs_ops.score.truth",)  # what renders are compared with
TRAINERS = ("mattgs_ops.trainers",)  # behind trainings by other programs


def code_version(stage: str, *more: str, root: Path = ROOT) -> str:
    """Return the digest of the code behind ``stage`` and of ``more`` modules (dotted names).

    Raises :class:`InputError` for a stage or module that is not there.
    """
    if stage not in STAGES:
        raise InputError(f"stage {stage!r}: expected one of {', '.join(STAGES)}")
    return digest_modules((*STAGES[stage], *more), root=root)


def digest_modules(names: Iterable[str], *, root: Path = ROOT) -> str:
    """Return the digest of modules and all that they depend on."""
    sources, libraries = dependencies(names, root=root)
    parts = {str(path.relative_to(root)): _source(path).meaning for path in sources}
    imported = {name for path in sources for name in _imports(path, root)}
    for module, folder in COMPILED.items():
        if any(name.startswith(module) for name in imported):
            found = _kernels(root, module, folder)
            parts |= {str(path.relative_to(root)): file_digest(path) for path in found}
    for module, weights in WEIGHTS.items():
        if any(name.startswith(module) for name in imported) and (root / weights).is_file():
            parts[str(weights)] = file_digest(root / weights)
    return json_digest({"sources": parts, "libraries": _versions(libraries)})


def dependencies(names: Iterable[str], *, root: Path = ROOT) -> tuple[list[Path], list[str]]:
    """Return the source files behind ``names``, and the numeric libraries that they import."""
    waiting = [path for name in names for path in _sources(name, root)]
    seen: set[Path] = set()
    libraries: set[str] = set()
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        for name in _imports(path, root):
            top = name.split(".")[0]
            if top == PACKAGE:
                waiting += _chain(name, root)
            elif top in LIBRARIES:
                libraries.add(top)
    return sorted(seen), sorted(libraries)


def _sources(name: str, root: Path) -> list[Path]:
    """Files of a module, or of a package with all of its modules."""
    base = root.joinpath(*name.split("."))
    found = sorted(base.rglob("*.py")) if base.is_dir() else [base.with_suffix(".py")]
    if not found or not all(path.is_file() for path in found):
        raise InputError(f"module {name!r}: no source under {root}")
    return found


def _chain(name: str, root: Path) -> Iterator[Path]:
    """Files that importing ``name`` runs: each package's ``__init__`` on the way, and itself.

    ``name`` may end in something that a module defines, which is no file of its own.
    """
    parts = name.split(".")
    for count in range(1, len(parts) + 1):
        base = root.joinpath(*parts[:count])
        for path in (base / "__init__.py", base.with_suffix(".py")):
            if path.is_file():
                yield path


@dataclass(frozen=True)
class _Source:
    """What a source file imports (level of relative import, dotted name), and a digest of it."""

    imports: tuple[tuple[int, str], ...]
    meaning: str


def _imports(path: Path, root: Path) -> Iterator[str]:
    package = path.relative_to(root).parent.parts
    for level, name in _source(path).imports:
        base = package[: len(package) - level + 1] if level else ()
        yield ".".join([*base, name])


def _source(path: Path) -> _Source:
    state = path.stat()
    return _parsed(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1024)
def _parsed(path: Path, changed: int, size: int) -> _Source:
    """Parse a file once per version of it on disk, which ``changed`` and ``size`` tell apart.

    What was found is kept by the file's contents: parsing all that is behind the stages takes two
    seconds, in each process that asks.
    """
    del changed, size
    text = path.read_bytes()
    key = hashlib.sha256(f"{PARSED_BY} {sys.version}\n".encode() + text).hexdigest()
    kept = KEPT.find(key)
    if kept is not None:
        return _Source(tuple((level, name) for level, name in kept["imports"]), kept["meaning"])
    found = _parse(text, path)
    KEPT.keep(key, {"imports": found.imports, "meaning": found.meaning})
    return found


def syntax_tree(text: bytes, path: Path) -> ast.Module:
    """Parse a source file, as the only thread here that does.

    Python 3.11 counts how deep it is in a tree for all threads together, and refuses one where it
    was switched to another thread meanwhile (python/cpython#106905); so may another library do.
    """
    with PARSING:
        for _ in range(PARSE_TRIES):
            with suppress(SystemError):
                return ast.parse(text, filename=str(path))
        return ast.parse(text, filename=str(path))


def _parse(text: bytes, path: Path) -> _Source:
    tree = syntax_tree(text, path)
    imports: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [(0, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = f"{node.module}." if node.module else ""
            imports += [(node.level, f"{start}{alias.name}") for alias in node.names]
        elif isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            _drop_docstring(node)
    _drop_docstring(tree)
    meaning = hashlib.sha256(ast.dump(tree).encode("utf-8")).hexdigest()
    return _Source(tuple(imports), meaning)


def _drop_docstring(
    node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef,
) -> None:
    if ast.get_docstring(node, clean=False) is not None:
        node.body = node.body[1:]


def _kernels(root: Path, module: str, folder: Path) -> list[Path]:
    """Return a compiled module's sources and build description, or without them the module."""
    sources = [path for path in sorted((root / folder).rglob("*")) if path.is_file()]
    build = [path for path in [root / "CMakeLists.txt"] if path.is_file()]
    name = module.rpartition(".")[2]
    return sources + build if sources else sorted((root / folder.parent).glob(f"{name}*.so"))


def _versions(libraries: Iterable[str]) -> dict[str, str]:
    found = {}
    for name in libraries:
        try:
            found[name] = version(LIBRARIES[name])
        except PackageNotFoundError:
            found[name] = "absent"
    return found
