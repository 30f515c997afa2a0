"""Render tables as Markdown, LaTeX and CSV."""

import csv
import io
import re
from collections.abc import Callable, Sequence

from col3d.reports.tables import Cell, Column, Line, Table, marks

INTERVAL, PAPER = "95 % interval", "in the paper"
ARROWS = {"down": "↓", "up": "↑", "": ""}
LATEX_ARROWS = {"down": r" $\downarrow$", "up": r" $\uparrow$", "": ""}
DASH, MINUS = "\N{EN DASH}", "\N{MINUS SIGN}"
SPECIAL = {
    DASH: "--",
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "δ": r"$\delta$",
    "°": r"$^\circ$",
    "±": r"$\pm$",
    "<": r"$<$",
    ">": r"$>$",
    MINUS: "$-$",
} | {sign: f"\\{sign}" for sign in "&%$#_{}"}
Text = Callable[[Column, Cell], str]


def heading(column: Column) -> str:
    """Heading with unit and an arrow in the better direction."""
    unit = f" ({column.unit})" if column.unit and column.unit not in column.heading else ""
    return f"{column.heading}{unit} {ARROWS[column.better]}".strip()


def number(column: Column, value: float | None, std: float | None = None) -> str:
    """Text of a mean with its standard deviation; a dash where there is none."""
    if value is None:
        return DASH
    return _minus(column.text(value)) + (f" ± {column.text(std)}" if std is not None else "")


def interval(column: Column, cell: Cell) -> str:
    """Text [low, high] of an interval; empty where there is none."""
    if cell.low is None or cell.high is None:
        return ""
    return _minus(f"[{column.text(cell.low)}, {column.text(cell.high)}]")


def paper(column: Column, cell: Cell) -> str:
    """The paper's number; empty where there is none."""
    return "" if cell.paper is None else number(column, cell.paper, cell.paper_std)


def markdown(table: Table) -> str:
    """Title, caption, the table with a row each for intervals and the paper's numbers, and notes."""
    lines = [[*table.heads, *(heading(column).replace("|", r"\|") for column in table.columns)]]
    lines.append(["---"] * len(table.heads) + ["---:"] * len(table.columns))
    for row, row_marks in zip(table.rows, marks(table), strict=True):
        own = [
            _marked(number(column, cell.value, cell.std), mark, "**{}**", "<u>{}</u>")
            for column, cell, mark in zip(table.columns, row.cells, row_marks, strict=True)
        ]
        lines.append([*map(as_text, row.heads), *own])
        lines += [[*_indented(row, name), *texts] for name, texts in _below(table, row)]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    notes = "\n".join(f"* {as_text(note)}" for note in table.notes)
    return (
        "\n\n".join(
            part for part in (f"### {as_text(table.title)}", as_text(table.caption), body, notes) if part
        )
        + "\n"
    )


def latex(table: Table) -> str:
    """A `table*` with booktabs rules: best bold, second underlined."""
    heads = [f"\\textbf{{{escape(head)}}}" for head in table.heads]
    heads += [
        f"{column.latex or escape(column.heading)}{LATEX_ARROWS[column.better]}" for column in table.columns
    ]
    body = []
    for i, (row, row_marks) in enumerate(zip(table.rows, marks(table), strict=True)):
        if table.grouped and i and row.heads[0] != table.rows[i - 1].heads[0]:
            body.append(r"\midrule")
        own = [
            _marked(escape(number(column, cell.value, cell.std)), mark, r"\textbf{{{}}}", r"\underline{{{}}}")
            for column, cell, mark in zip(table.columns, row.cells, row_marks, strict=True)
        ]
        body.append(_latex_row([*map(escape, row.heads), *own]))
        for name, texts in _below(table, row):
            small = [
                f"{{\\scriptsize {escape(text)}}}" if text else "" for text in (*_indented(row, name), *texts)
            ]
            body.append(_latex_row(small))
    return _latex_frame(table, _latex_row(heads), body)


def _latex_frame(table: Table, heads: str, body: Sequence[str]) -> str:
    caption = " ".join((f"{table.title}. {table.caption}", *table.notes))
    return "\n".join(
        [
            "% needs \\usepackage{booktabs,graphicx}",
            r"\begin{table*}[t]",
            r"\centering",
            f"\\caption{{{escape(caption)}}}",
            f"\\label{{tab:{table.name.replace('_', '-')}}}",
            r"\resizebox{\textwidth}{!}{%",
            f"\\begin{{tabular}}{{{'l' * len(table.heads)}{'c' * len(table.columns)}}}",
            r"\toprule",
            heads,
            r"\midrule",
            *body,
            r"\bottomrule",
            r"\end{tabular}}",
            r"\end{table*}",
            "",
        ]
    )


def comma_separated(table: Table) -> str:
    """Plain numbers in full precision, one column each; columns that are empty throughout are left out."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    parts = {"": "value", "_std": "std", "_low": "low", "_high": "high", "_paper": "paper"}
    parts["_paper_std"] = "paper_std"
    used = [
        (j, column, ending, part)
        for j, column in enumerate(table.columns)
        for ending, part in parts.items()
        if not ending or any(getattr(row.cells[j], part) is not None for row in table.rows)
    ]
    writer.writerow(
        [_file_key(h) for h in table.heads] + [f"{c.file_key}{ending}" for _, c, ending, _ in used]
    )
    for row in table.rows:
        values = (getattr(row.cells[j], part) for j, _, _, part in used)
        writer.writerow([*row.heads, *("" if value is None else value for value in values)])
    return text.getvalue()


def escape(text: str) -> str:
    """Escape text for LaTeX."""
    return "".join(SPECIAL.get(sign, sign) for sign in text)


def _file_key(head: str) -> str:
    return re.sub(r"\W+", "_", head.lower()).strip("_")


def as_text(text: str) -> str:
    """Escape text for Markdown; underscores inside words are left alone."""
    return re.sub(r"([\\`*\[\]<>|#]|(?<!\w)_|_(?!\w))", r"\\\1", text)


def as_code(text: str) -> str:
    """Format text as code inside a line of Markdown, whatever backticks it has."""
    most = max((len(run) for run in re.findall("`+", text)), default=0)
    fence, space = "`" * (most + 1), " " * bool(most)
    return f"{fence}{space}{text}{space}{fence}"


def _minus(text: str) -> str:
    """Replace hyphens by minus signs."""
    return text.replace("-", MINUS)


def _marked(text: str, mark: str, best: str, second: str) -> str:
    return {"best": best, "second": second}.get(mark, "{}").format(text)


def _indented(row: Line, name: str) -> list[str]:
    """Leading texts of a row below another one: its name is under the last head."""
    return [""] * (len(row.heads) - 1) + [name]


def _below(table: Table, row: Line) -> list[tuple[str, list[str]]]:
    """Rows under a row: intervals and the paper's numbers, where there are any."""
    texts: dict[str, Text] = {INTERVAL: interval, PAPER: paper}
    rows = {
        name: [text(column, cell) for column, cell in zip(table.columns, row.cells, strict=True)]
        for name, text in texts.items()
    }
    return [(name, line) for name, line in rows.items() if any(line)]


def _latex_row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"
