"""The one rule of the architecture: data flows one way, so imports do too.

``mattgs_ops`` comes first, then ``tasks`` and ``reports`` (which do not know each other), then
``flows``. Inside a package each room (sub-package) imports only the rooms that are listed for it,
and the package's own modules at the top (configuration, errors).
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ORCHESTRATION = {"prefect", "prefect_dask", "dask", "distributed", "mlflow"}
FORBIDDEN = {
    "mattgs_ops": ORCHESTRATION | {"tasks", "reports", "flows"},
    "tasks": {"reports", "flows"},
    "reports": ORCHESTRATION | {"tasks", "flows"},
    "flows": set(),
}
# room → the rooms of the same package that it may import, besides itself and top-level modules
ROOMS = {
    "mattgs_ops": {
        "timing": set(),
        "store": {"timing"},
        "capture": set(),
        "synthetic": {"capture"},
        "segment": {"capture", "store", "synthetic"},
        "sfm": {"capture"},
        "splat": {"capture", "timing"},
        "trainers": {"capture", "splat", "store", "timing"},
        "object_masks": {"capture", "segment", "sfm", "splat"},
        "score": {"capture", "splat", "store", "timing"},
    },
    "tasks": {"stages": set(), "registry": {"stages"}},
    "reports": {
        "rows": set(),
        "tables": {"rows"},
        "figures": {"rows", "tables"},
        "page": {"rows", "tables", "figures"},
        "gate": {"rows", "tables", "figures"},
        "history": {"rows", "gate"},
    },
    "flows": {
        "services": set(),
        "prefect_ui": set(),
        "results": {"services"},
        "starter": set(),
        "cli": {"services", "prefect_ui", "results", "starter"},
    },
}
# the only modules that talk to MLflow: the registry, and the model flavour that MLflow itself loads
MLFLOW_SPEAKERS = {"tasks/registry", "tasks/splat_model.py"}
OTHER_CODE = ("tests", "benchmarks")  # that keeps to the same sizes
MOST_LINES = 300
MOST_FILES = 12  # of one folder, its sub-packages not counted


def imported(path: Path) -> set[str]:
    """Return the dotted names that a module imports, those inside functions included."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def modules(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def sources(folder: str) -> list[Path]:
    """Return the modules below a folder, and the kernels in C++."""
    kernels = (path for path in (ROOT / folder).rglob("*") if path.suffix in {".cpp", ".h"})
    return modules(folder) + sorted(kernels)


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_a_package_imports_only_the_packages_below_it(package: str) -> None:
    assert modules(package), f"no modules under {package}/"
    for path in modules(package):
        assert not {name.split(".")[0] for name in imported(path)} & FORBIDDEN[package], path


@pytest.mark.parametrize(
    ("package", "room"), [(package, room) for package, rooms in ROOMS.items() for room in rooms]
)
def test_a_room_imports_only_the_rooms_below_it(package: str, room: str) -> None:
    assert modules(f"{package}/{room}"), f"no modules under {package}/{room}/"
    allowed = ROOMS[package][room] | {room}
    for path in modules(f"{package}/{room}"):
        used = {name.split(".")[1] for name in imported(path) if name.startswith(f"{package}.")}
        assert used & set(ROOMS[package]) <= allowed, path


@pytest.mark.parametrize("package", sorted(ROOMS))
def test_every_room_is_listed_and_says_what_is_inside(package: str) -> None:
    rooms = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
    assert rooms == set(ROOMS[package])
    for path in (ROOT / package).rglob("__init__.py"):
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        assert text, f"{path}: expected a docstring"
        assert len(text.splitlines()) >= 2, f"{path}: expected what is inside, and its public face"


def test_only_the_registry_talks_to_mlflow() -> None:
    for package in FORBIDDEN:
        for path in modules(package):
            if any(name.split(".")[0] == "mlflow" for name in imported(path)):
                name = str(path.relative_to(ROOT))
                assert name.startswith(tuple(MLFLOW_SPEAKERS)), name


@pytest.mark.parametrize("package", [*sorted(FORBIDDEN), *OTHER_CODE])
def test_sources_stay_small_and_are_named_for_what_they_do(package: str) -> None:
    for path in sources(package):
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines <= MOST_LINES, f"{path}: {lines} lines; one stage, one file"
        assert path.stem not in {"utils", "util", "helpers", "common", "misc"}, path


@pytest.mark.parametrize("package", [*sorted(FORBIDDEN), *OTHER_CODE])
def test_folders_stay_small(package: str) -> None:
    of_folders: dict[Path, list[str]] = {}
    for path in sources(package):
        of_folders.setdefault(path.parent, []).append(path.name)
    for folder, files in of_folders.items():
        assert len(files) <= MOST_FILES, f"{folder}: {len(files)} files: {files}"
