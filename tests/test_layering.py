"""The house's one rule: each floor imports only the floors below it."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FORBIDDEN = {
    "mattgs_ops": {
        "prefect",
        "prefect_dask",
        "dask",
        "distributed",
        "mlflow",
        "tasks",
        "reports",
        "flows",
    },
    "tasks": {"reports", "flows"},
    "reports": {"prefect", "prefect_dask", "dask", "distributed", "mlflow", "tasks", "flows"},
    "flows": set(),
}
# the only modules that talk to MLflow (the command line may look its place up through them)
MLFLOW_SPEAKERS = {str(path.relative_to(ROOT)) for path in (ROOT / "tasks").glob("registry*.py")}


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


def modules(floor: str) -> list[Path]:
    return sorted((ROOT / floor).rglob("*.py"))


@pytest.mark.parametrize("floor", sorted(FORBIDDEN))
def test_a_floor_imports_only_the_floors_below_it(floor: str) -> None:
    assert modules(floor), f"no modules under {floor}/"
    for path in modules(floor):
        assert not imports_of(path) & FORBIDDEN[floor], path


def test_only_the_registry_talks_to_mlflow() -> None:
    speakers = {
        str(path.relative_to(ROOT))
        for floor in FORBIDDEN
        for path in modules(floor)
        if "mlflow" in imports_of(path)
    }
    assert speakers <= MLFLOW_SPEAKERS


@pytest.mark.parametrize("floor", sorted(FORBIDDEN))
def test_modules_stay_small_and_are_named_for_what_they_do(floor: str) -> None:
    for path in modules(floor):
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines <= 340, f"{path}: {lines} lines; one stage, one file, about 300 lines"
        assert path.stem not in {"utils", "util", "helpers", "common", "misc"}, path
