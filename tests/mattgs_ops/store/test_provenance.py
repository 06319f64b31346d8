"""Provenance names the machine, the libraries and the commit, and does not guess."""

import json
import subprocess
from pathlib import Path

from mattgs_ops.store.provenance import cpu_kind, cpu_model, describe, git_commit, versions


def git(folder: Path, *arguments: str) -> str:
    who = ["-c", "user.name=T", "-c", "user.email=t@example.org"]
    command = ["git", "-C", str(folder), *who, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def repository(folder: Path) -> Path:
    package = folder / "package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("X = 1\n")
    git(folder, "init", "-q")
    git(folder, "add", "package/__init__.py")
    git(folder, "commit", "-q", "-m", "one")
    return package


def test_everything_is_json_and_says_how_many_threads() -> None:
    found = json.loads(json.dumps(describe(threads=3)))
    assert found["threads"] == 3
    assert found["cores"] >= 1
    assert found["cpu"]
    machine = {"cpu", "cpu_kind", "cores", "threads", "platform", "workload"}
    assert set(found) == {"versions", "git"} | machine


def test_versions_are_those_of_the_installed_libraries() -> None:
    import numpy as np

    found = versions()
    assert found["numpy"] == np.__version__
    assert found["python"].startswith("3.")


def test_the_processor_is_named_or_its_architecture(tmp_path: Path) -> None:
    file = tmp_path / "cpuinfo"
    file.write_text("processor\t: 0\nmodel name\t: Fast: One @ 3 GHz\n")
    assert cpu_model(file) == "Fast: One @ 3 GHz"
    assert cpu_model(tmp_path / "absent")


def test_processors_of_one_name_are_told_apart(tmp_path: Path) -> None:
    file = tmp_path / "cpuinfo"
    file.write_text("cpu family\t: 25\nmodel\t\t: 1\nmodel name\t: EPYC\nflags\t\t: fpu avx avx2\n")
    assert cpu_kind(file).endswith("cpu family 25 model 1 avx2")
    assert cpu_kind(tmp_path / "absent")


def test_the_commit_is_told_and_edits_are_marked(tmp_path: Path) -> None:
    package = repository(tmp_path)
    commit = git(tmp_path, "rev-parse", "HEAD")
    assert git_commit(package) == commit
    (tmp_path / "elsewhere.txt").write_text("x")
    assert git_commit(package) == commit
    (package / "__init__.py").write_text("X = 2\n")
    assert git_commit(package) == f"{commit}+changes"


def test_an_installed_package_in_a_foreign_repository_has_no_commit(tmp_path: Path) -> None:
    repository(tmp_path)
    installed = tmp_path / "site-packages" / "mattgs_ops"
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text("")
    assert git_commit(installed) is None
    assert git_commit(tmp_path / "nowhere") is None
