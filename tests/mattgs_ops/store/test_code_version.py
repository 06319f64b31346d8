"""The code version changes when what a stage runs changes, and only then."""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import mattgs_ops.config
from mattgs_ops.errors import InputError
from mattgs_ops.store.code_version import (
    ROOT,
    STAGES,
    code_version,
    dependencies,
    digest_modules,
    syntax_tree,
)

SOURCES = {
    "mattgs_ops/__init__.py": '"""Root."""\n',
    "mattgs_ops/one.py": (
        '"""One."""\nimport json\nimport numpy as np\nfrom mattgs_ops.two import f\n'
        "def g():\n    from mattgs_ops.deep import late\n    return f, late, np, json\n"
    ),
    "mattgs_ops/two.py": "from . import three\ndef f(x):\n    '''Doc.'''\n    return x + 1\n",
    "mattgs_ops/three.py": "X = 1\n",
    "mattgs_ops/deep/__init__.py": "Y = 1\n",
    "mattgs_ops/deep/late.py": "Z = 1\n",
    "mattgs_ops/deep/worker.py": "from mattgs_ops.splat import _engine\n",
    "mattgs_ops/splat/__init__.py": "",
    "mattgs_ops/splat/_kernels/pixels/a.cpp": "int a;\n",
    "mattgs_ops/sfm/colmap/__init__.py": "",
    "mattgs_ops/sfm/colmap/match.py": "from mattgs_ops.sfm.colmap import _descriptors\n",
    "mattgs_ops/sfm/colmap/_kernels/b.cpp": "int b;\n",
    "mattgs_ops/apart.py": "import torch\n",
    "tasks/wrap.py": "from mattgs_ops import one\n",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name, text in SOURCES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    later = path.stat().st_mtime_ns + 1_000_000_000  # as if typed by a person, not within a tick
    os.utime(path, ns=(later, later))


def names(root: Path, *modules: str) -> set[str]:
    return {str(path.relative_to(root)) for path in dependencies(modules, root=root)[0]}


def test_imports_are_followed_relative_and_late_ones_too(root: Path) -> None:
    assert names(root, "mattgs_ops.one") == {
        "mattgs_ops/__init__.py",
        "mattgs_ops/one.py",
        "mattgs_ops/two.py",
        "mattgs_ops/three.py",
        "mattgs_ops/deep/__init__.py",
        "mattgs_ops/deep/late.py",
    }


def test_a_package_stands_for_all_of_its_modules(root: Path) -> None:
    assert "mattgs_ops/deep/worker.py" in names(root, "mattgs_ops.deep")


def test_modules_of_other_packages_can_begin_the_walk(root: Path) -> None:
    assert {"tasks/wrap.py", "mattgs_ops/three.py"} <= names(root, "tasks.wrap")


def test_only_numeric_libraries_count(root: Path) -> None:
    assert dependencies(["mattgs_ops.one"], root=root)[1] == ["numpy"]


@pytest.mark.parametrize("file", ["one.py", "two.py", "three.py", "deep/late.py"])
def test_a_change_in_any_dependency_shows(root: Path, file: str) -> None:
    before = digest_modules(["mattgs_ops.one"], root=root)
    edit(root / "mattgs_ops" / file, "1" if file != "one.py" else "late, np", "2")
    assert digest_modules(["mattgs_ops.one"], root=root) != before


def test_comments_formatting_and_docstrings_do_not_count(root: Path) -> None:
    before = digest_modules(["mattgs_ops.one"], root=root)
    edit(root / "mattgs_ops/two.py", "return x + 1", "return (x   +  1)  # why")
    edit(root / "mattgs_ops/two.py", "'''Doc.'''", "'''Another.'''")
    assert digest_modules(["mattgs_ops.one"], root=root) == before


def test_what_is_not_imported_does_not_count(root: Path) -> None:
    before = digest_modules(["mattgs_ops.one"], root=root)
    edit(root / "mattgs_ops/apart.py", "import torch", "import numpy")
    edit(root / "mattgs_ops/splat/_kernels/pixels/a.cpp", "int a", "int b")
    assert digest_modules(["mattgs_ops.one"], root=root) == before


def test_kernels_count_for_what_runs_the_engine(root: Path) -> None:
    before = digest_modules(["mattgs_ops.deep"], root=root)
    matching = digest_modules(["mattgs_ops.sfm.colmap.match"], root=root)
    edit(root / "mattgs_ops/splat/_kernels/pixels/a.cpp", "int a", "int b")
    engine = digest_modules(["mattgs_ops.deep"], root=root)
    assert engine != before
    assert digest_modules(["mattgs_ops.sfm.colmap.match"], root=root) == matching
    edit(root / "mattgs_ops/sfm/colmap/_kernels/b.cpp", "int b", "int c")
    assert digest_modules(["mattgs_ops.deep"], root=root) == engine
    assert digest_modules(["mattgs_ops.sfm.colmap.match"], root=root) != matching


def test_the_place_of_the_sources_does_not_count(root: Path, tmp_path: Path) -> None:
    before = digest_modules(["mattgs_ops.one"], root=root)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for part in ("mattgs_ops", "tasks"):
        (root / part).rename(moved / part)
    assert digest_modules(["mattgs_ops.one"], root=moved) == before


def test_what_is_not_there_is_named(root: Path) -> None:
    with pytest.raises(InputError, match=r"module 'mattgs_ops\.no': no source"):
        digest_modules(["mattgs_ops.no"], root=root)
    with pytest.raises(InputError, match="stage 'sing': expected one of prepare"):
        code_version("sing")


@pytest.mark.parametrize("stage", STAGES)
def test_the_real_stages_have_a_version_each(stage: str) -> None:
    assert code_version(stage) == code_version(stage)
    files, libraries = dependencies(STAGES[stage])
    assert "numpy" in libraries
    assert all(path.is_relative_to(ROOT) for path in files)


def test_the_training_depends_on_the_engine_and_not_on_the_segmenter() -> None:
    files = {str(path.relative_to(ROOT)) for path in dependencies(STAGES["train"])[0]}
    assert "mattgs_ops/splat/rasterize.py" in files
    assert not any(name.startswith(("mattgs_ops/segment", "mattgs_ops/sfm/")) for name in files)


class Switch:
    """Lets another thread go on when it is collected, as objects with locks or files do."""

    def __init__(self) -> None:
        self.me = self  # only the collector removes it, which begins anywhere

    def __del__(self) -> None:
        time.sleep(0)


def test_several_threads_may_parse_at_once() -> None:
    source = Path(mattgs_ops.config.__file__)
    text, end = source.read_bytes(), time.monotonic() + 3
    refused: list[SystemError] = []

    def parse() -> None:
        while time.monotonic() < end:
            _ = [Switch() for _ in range(3)]
            try:
                syntax_tree(text, source)
            except SystemError as error:
                refused.append(error)

    with ThreadPoolExecutor(3) as threads:
        for _ in range(3):
            threads.submit(parse)
    assert not refused


def test_weights_count_where_their_module_is_imported(root: Path) -> None:
    weights = root / "mattgs_ops/bundled/segmenter/outline-int8.onnx"
    weights.parent.mkdir(parents=True)
    weights.write_bytes(b"a")
    user = root / "mattgs_ops/user.py"
    user.write_text("from mattgs_ops.segment.outline.refine import OutlineRefiner\n")
    refine = root / "mattgs_ops/segment/outline/refine.py"
    refine.parent.mkdir(parents=True)
    refine.write_text("W = 1\n")
    before = {name: digest_modules([f"mattgs_ops.{name}"], root=root) for name in ("user", "three")}
    weights.write_bytes(b"b")
    assert digest_modules(["mattgs_ops.user"], root=root) != before["user"]
    assert digest_modules(["mattgs_ops.three"], root=root) == before["three"]
