"""The five formats say the same, and each is valid in its own language."""

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from reports.rows.schema import read_rows
from reports.tables import formats, latex, paper, side_tables, tables
from reports.tables.formats import Entry, Group, Line, Table

Row = dict[str, Any]
RESULTS = Path(__file__).parents[3] / "reports" / "results"
COMMITTED = sorted({path.parent.name for path in RESULTS.glob("*/*.json")})


@pytest.fixture
def table() -> Table:
    lines = (
        Line("3DGS", (Entry("25.00", "0.10", True, 25.0, 0.1), Entry("–")), ("a" * 32,)),
        Line("Ours & <b>", (Entry("24.00", "", False, 24.0), Entry("5", value=5)), (), " (a)"),
    )
    groups = (Group("No BG", lines),)
    return Table("t", "Title_1 % | x", ("PSNR↑", "N"), ("psnr", "n"), groups, ("(a) why?",))


class Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        del attrs
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_html_is_balanced_and_escaped(table: Table) -> None:
    reader = Reader()
    reader.feed(formats.html(table))
    assert reader.open == []
    assert "Ours & <b> (a)" in reader.words


def test_markdown_has_as_many_cells_in_every_row(table: Table) -> None:
    rows = [line for line in formats.markdown(table).splitlines() if line.startswith("|")]
    assert len({line.replace("\\|", "").count("|") for line in rows}) == 1
    assert "**25.00 ± 0.10**" in rows[2]


def test_latex_escapes_what_it_reads_as_commands(table: Table) -> None:
    text = latex.latex(table)
    assert r"\caption{Title\_1 \% \textbar{} x}" in text
    assert r"Ours \& \textless{}b\textgreater{} (a)" in text
    assert r"\textbf{25.00 $\pm$ 0.10}" in text


def test_every_sign_of_the_real_tables_is_known_to_latex(
    make_grid: Callable[..., list[Row]],
) -> None:
    for table in side_tables.all_tables(make_grid(seeds=2)):
        text = latex.latex(table)
        assert text.isascii(), table.slug
        assert "[U+" not in text, table.slug


@pytest.mark.parametrize("folder", COMMITTED)
def test_every_sign_of_the_committed_rows_tables_is_known_to_latex(folder: str) -> None:
    rows = [row for path in sorted((RESULTS / folder).glob("*.json")) for row in read_rows(path)]
    for table in side_tables.all_tables(rows):
        text = latex.latex(table)
        assert text.isascii(), (table.slug, {letter for letter in text if not letter.isascii()})
        assert "[U+" not in text, table.slug


def test_settings_in_notes_are_code_on_the_page_and_in_latex(table: Table) -> None:
    noted = replace(table, notes=("no weights (`lpips`), <none>",))
    assert "<li>no weights (<code>lpips</code>), &lt;none&gt;</li>" in formats.html(noted)
    assert r"no weights (\texttt{lpips})" in latex.latex(noted)


def test_a_median_has_a_line_of_its_own_on_the_page() -> None:
    entry = Entry("+0.50", "0.10", value=0.5, aside="median +0.40")
    assert entry.full == "+0.50 ± 0.10 (median +0.40)"
    table = Table("t", "T", ("PSNR",), ("psnr",), (Group("a", (Line("b", (entry,)),)),))
    assert '± 0.10</span><br><span class="spread">median +0.40</span>' in formats.html(table)


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex on this machine")
def test_latex_compiles_and_fits_the_line(
    make_grid: Callable[..., list[Row]], make_failed: Callable[..., Row], tmp_path: Path
) -> None:
    rows = make_grid(captures=("rover", "my_gripper & co"), methods=("3dgs", "ours+"), seeds=2)
    for row in rows:
        row["metrics"] |= {"detail_psnr": 20.0, "detail_ssim": 0.7, "train_paper_l1": 0.01}
    rows[-1] = make_failed("rover", "nobg", "ours", r"C:\x_y #2 — {see} ~/log^2: 5 % ≥ $3")
    values = tmp_path / "values.toml"
    cell = 'capture="rover"\nbackground="nobg"\nmethod="ours+"\n'
    values.write_text(f"[source]\nread_from='p. 5'\n[[value]]\n{cell}psnr=30.0\ntime=800\n")
    found = side_tables.all_tables(rows, paper.load(values))
    body = "\n".join(latex.latex(table) for table in found)
    head = r"\documentclass{article}\usepackage{booktabs,graphicx}"
    (tmp_path / "t.tex").write_text(head + r"\begin{document}" + body + r"\end{document}")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "t.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout


def test_plain_marks_the_best_and_keeps_columns_aligned(table: Table) -> None:
    lines = formats.plain(table).splitlines()
    assert "25.00±0.10*" in lines[4]
    assert lines[4].index("25.00") + len("25.00±0.10") == lines[5].index("24.00") + len("24.00")
    assert "aaaaaaaa" in lines[4]
    assert "a" * 9 not in lines[4]


@pytest.mark.parametrize("folder", COMMITTED)
def test_a_terminal_of_80_columns_holds_the_committed_tables(folder: str) -> None:
    for path in sorted((RESULTS / folder).glob("*.json")):
        assert max(map(len, tables.terminal(read_rows(path)).splitlines())) <= 80, path


def test_a_narrow_table_has_a_short_heading_and_keeps_its_runs() -> None:
    entries = tuple(Entry("1.000") for _ in range(5)), tuple(Entry("1.000") for _ in range(8))
    shown = []
    for own in entries:
        heads = (*(f"S{i}↑" for i in range(len(own) - 1)), "Size(MB)↓")
        lines = (Line("a", own, ("b" * 32,)),)
        table = Table("t", "T", heads, heads, (Group("No BG", lines),))
        shown.append(formats.plain(table).splitlines()[2])
    assert shown[0].split()[-2:] == ["Size(MB)↓", "Run"]
    assert shown[1].split()[-2:] == ["MB↓", "Run"]


@pytest.mark.parametrize(("columns", "time"), [(6, "1h 02m 03s"), (7, "1h 02m")])
def test_the_narrowest_table_has_no_seconds_beside_hours(columns: int, time: str) -> None:
    entries = tuple(Entry("1.000") for _ in range(columns)), (Entry("1h 02m 03s"), Entry("2m 03s"))
    heads = tuple(f"S{i}↑" for i in range(columns + 2))
    lines = (Line("a", (*entries[0], *entries[1]), ("b" * 32,)),)
    table = Table("t", "T", heads, heads, (Group("No BG", lines),))
    row = formats.plain(table).splitlines()[4]
    assert f" {time} " in row
    assert " 2m 03s" in row


def test_latex_carries_what_another_program_said() -> None:
    told = latex.latex_escape("loss=0.5 → 7 <b>x</b> | é ✓ 中")
    assert told == (
        r"loss=0.5 $\rightarrow$ 7 \textless{}b\textgreater{}x\textless{}/b\textgreater{} "
        r"\textbar{} é [U+2713] [U+4E2D]"
    )


def test_marks_of_failed_lines_never_repeat() -> None:
    marks = [tables._letters(number) for number in range(800)]
    assert marks[:3] == ["a", "b", "c"]
    assert marks[25:28] == ["z", "aa", "ab"]
    assert marks[701:703] == ["zz", "aaa"]
    assert len(set(marks)) == 800
