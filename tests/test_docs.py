"""Documents hold what is there: Python in them imports it, links and paths lead to it."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "reports").rglob("*.md")]
OWN = ("flows", "tasks", "mattgs_ops", "reports", "benchmarks")
PYTHON = re.compile(r"^```python\n(.*?)^```", re.M | re.S)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
# a file of the project, its own folders' files also by where they lie in `mattgs_ops`
NAMED = re.compile(r"`((?!https?:)[\w.-]+/[\w./+-]+\.(?:py|cpp|hpp|sh))`")
BELOW = (ROOT, ROOT / "mattgs_ops", ROOT / "mattgs_ops" / "splat")
PLACEHOLDER = "NAME"

documents = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))


@documents
def test_examples_import_what_is_there(document: Path) -> None:
    for code in PYTHON.findall(document.read_text(encoding="utf-8")):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OWN:
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    if not hasattr(module, alias.name):
                        importlib.import_module(f"{node.module}.{alias.name}")


@documents
def test_links_and_named_files_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    links = [link for link in LINK.findall(text) if "://" not in link]
    lost = [link for link in links if not (document.parent / link).exists()]
    named = [path for path in NAMED.findall(text) if PLACEHOLDER not in path]
    lost += [path for path in named if not any((folder / path).exists() for folder in BELOW)]
    assert not lost
