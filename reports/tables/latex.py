"""A table in LaTeX, in the manner of `booktabs`."""

from reports.tables.formats import CODE, Table

# Characters that LaTeX reads as commands, and signs that its default fonts do not carry.
_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "^": r"\textasciicircum{}",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "−": r"$-$",
    "≥": r"$\geq$",
    "≈": r"$\approx$",
    "→": r"$\rightarrow$",
    "←": r"$\leftarrow$",
    "∞": r"$\infty$",
    "√": r"$\surd$",
    "µ": r"$\mu$",
    "≤": r"$\leq$",
    "–": "--",
    "—": "---",
    "·": r"$\cdot$",
    "†": r"\textsuperscript{\dag}",
    "‡": r"\textsuperscript{\ddag}",
    "ø": r"\o{}",
    "\u202f": r"\,",
    "…": r"\ldots{}",
    "²": r"\textsuperscript{2}",
    "σ": r"$\sigma$",
    "λ": r"$\lambda$",
    "Δ": r"$\Delta$",
    "★": r"$\star$",
}
_LAST_ACCENTED = "ſ"  # the end of Latin Extended-A: what LaTeX's default encodings know


def latex_escape(text: str) -> str:
    """Escape text for LaTeX; the signs that tables use become commands, backticks a typewriter.

    pdfLaTeX ends at a sign that its fonts do not carry, as in what other programs said: its number
    in Unicode stands there.
    """
    plain = "".join(_LATEX.get(letter, letter) for letter in text)
    plain = "".join(c if c <= _LAST_ACCENTED else f"[U+{ord(c):04X}]" for c in plain)
    return CODE.sub(r"\\texttt{\1}", plain)


def latex(table: Table) -> str:
    """Write a ``table`` environment in booktabs' manner, made smaller where the line is shorter."""
    out = [
        r"% needs \usepackage{booktabs,graphicx}",
        r"\begin{table}[t]",
        r"\centering\small",
        rf"\caption{{{latex_escape(table.title)}}}",
        rf"\label{{tab:{table.slug}}}",
        rf"\sbox0{{\begin{{tabular}}{{ll{'r' * len(table.headings)}}}",
        r"\toprule",
        " & ".join(latex_escape(h) for h in ("", table.first, *table.headings)) + r" \\",
    ]
    for group in table.groups:
        out.append(r"\midrule")
        for index, line in enumerate(group.lines):
            entries = [latex_escape(e.full) for e in line.entries]
            pairs = zip(entries, line.entries, strict=True)
            best = [rf"\textbf{{{text}}}" if entry.best else text for text, entry in pairs]
            label = latex_escape(line.name)
            first = latex_escape(group.label) if index == 0 else ""
            out.append(" & ".join([first, label, *best]) + r" \\")
            runs = ", ".join(line.runs)
            out.append(f"% runs: {runs}" if runs else "% no run")
    out += [r"\bottomrule", r"\end{tabular}}%"]
    out.append(r"\ifdim\wd0>\linewidth\resizebox{\linewidth}{!}{\usebox0}\else\usebox0\fi")
    if table.notes:
        joined = r" \\ ".join(latex_escape(note) for note in table.notes)
        out += [rf"\\[2pt]\parbox{{\linewidth}}{{\footnotesize {joined}}}"]
    return "\n".join([*out, r"\end{table}"]) + "\n"
