"""One report of a benchmark that was run in parts: from files of rows, without a registry.

Each sitting of a long benchmark leaves ``OUT/benchmarks/NAME/rows.json``. Where the rest of that
output folder is still there, its renders and splats are shown; elsewhere the report says that they
are missing.
"""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from flows.grid import cells
from mattgs_ops.config import BenchmarkConfig
from mattgs_ops.config_file import load_toml
from mattgs_ops.errors import InputError
from reports.page.build import build
from reports.rows.merge import Part, merge
from reports.rows.schema import Row, capture_name, condition_name, limited, read_rows
from reports.tables import paper
from tasks.row import config_digest
from tasks.stages.cores import own_cores
from tasks.stages.stage import Cell

STORE = "store"  # in an output folder


def compile_report(
    files: Sequence[Path], out: Path, config: Path | None = None, paper_values: Path | None = None
) -> Path:
    """Build one report from the rows of all ``files`` below ``out``; return its path.

    With ``config``, the benchmark's own TOML file, the report says which experiments of the grid
    are missing. Raises :class:`InputError` for rows that do not belong together or to the grid,
    and rather than overwriting one of the files.
    """
    values = None if paper_values is None else paper.load(paper_values)
    parts: list[Part] = [(str(file), read_rows(file)) for file in files]
    rows = merge(parts)
    if not rows:
        raise InputError(f"{', '.join(map(str, files))}: expected at least one row, found none")
    name = str(rows[0]["benchmark"])
    folder = out / "benchmarks" / name
    for file in files:
        if file.resolve() == (folder / "rows.json").resolve():
            raise InputError(f"{file}: the report would overwrite it; name another folder by --out")
    notes = [_sources(parts)] if len(files) > 1 else []
    planned = None
    if config is not None:
        grid = load_toml(config)
        missing = missing_of(rows, grid, str(config))
        planned = sum(1 for _ in _expected(grid))
        notes += _missing_sentences(missing, planned)
    with tempfile.TemporaryDirectory(prefix="mattgs-report-") as place:
        return build(
            rows,
            folder,
            title=f"Benchmark {name}",
            artifacts_root=_gather(
                zip(files, (rows for _, rows in parts), strict=True), Path(place)
            ),
            values=values,
            notes=notes,
            planned=planned,
            processes=own_cores(),
        )


def missing_of(rows: Sequence[Row], config: BenchmarkConfig, source: str) -> list[Cell]:
    """Return the experiments of a grid that no row is of.

    Raises :class:`InputError` for a row that is of no experiment of the grid, or of one that was
    configured otherwise.
    """
    if rows[0]["benchmark"] != config.name:
        raise InputError(
            f"{source}: expected benchmark {rows[0]['benchmark']!r}, found {config.name!r}"
        )
    expected = list(_expected(config))
    present = set()
    for row in rows:
        cell = Cell.of(row)
        size = f"{row['iterations']}x{row['resolution']}"
        if cell not in expected or size != f"{config.iterations}x{config.resolution}":
            raise InputError(f"{source}: its grid has no {cell} at {size}, which the rows have")
        digest = (row.get("provenance") or {}).get("config_digest")
        if digest is not None and digest != config_digest(config, cell):
            raise InputError(f"{source}: {cell} was run with another configuration")
        present.add(cell)
    return [cell for cell in expected if cell not in present]


def _expected(config: BenchmarkConfig) -> Iterator[Cell]:
    for capture in config.captures:
        yield from cells(config, capture.name)


def _sources(parts: Sequence[Part]) -> str:
    counts = ", ".join(f"{name} ({len(rows)})" for name, rows in parts)
    return f"Put together from {len(parts)} files of rows: {counts}."


def _missing_sentences(missing: Sequence[Cell], planned: int) -> list[str]:
    if not missing:
        return []
    captures: dict[str, list[Cell]] = {}
    for cell in missing:
        captures.setdefault(cell.capture, []).append(cell)
    sentences = [f"{len(missing)} of the grid's {planned} experiments are missing."]
    for capture, rows_of_capture in captures.items():
        seeds: dict[str, list[int]] = {}
        for cell in rows_of_capture:
            name = limited(condition_name(*cell.condition.split("-", 1)), cell.budget or 0)
            seeds.setdefault(name, []).append(cell.seed)
        alike: dict[tuple[int, ...], list[str]] = {}
        for printed, own in seeds.items():
            alike.setdefault(tuple(own), []).append(printed)
        texts = [
            f"{', '.join(names)} ({'seed' if len(own) == 1 else 'seeds'} "
            f"{', '.join(map(str, own))})"
            for own, names in alike.items()
        ]
        sentences.append(f"Not run yet, {capture_name(capture)}: {'; '.join(texts)}.")
    return sentences


def _gather(parts: Iterator[tuple[Path, Sequence[Row]]], root: Path) -> Path:
    """Link below ``root`` what rows refer to and what is still there, and return ``root``."""
    for file, rows in parts:
        store = file.resolve().parent.parent.parent / STORE
        for row in rows:
            for name in (row.get("artifacts") or {}).values():
                place = root / name
                if (store / name).is_dir() and not place.exists():
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.symlink_to(store / name)
    return root
