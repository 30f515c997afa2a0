"""Tables of results: columns, cells, rows, and which cells are best."""

from dataclasses import dataclass, replace

from col3d.registry.metric_specs import OURS, MetricSpec


@dataclass(frozen=True)
class Column:
    """Metric or fact of a table's column, and how it is printed.

    Attributes:
        key: name in files.
        heading: heading for readers.
        latex: heading in LaTeX; the other one, escaped, where it is empty.
        better: "down", "up", or "" where neither is.
        decimals: digits after the point.
        scale: factor of the values of `per_frame.csv`: 100 for shares that the paper has in percent.
        task: the task that it measures: "depth", "normals", or "" for all else.
    """

    key: str
    heading: str
    latex: str
    better: str = ""
    decimals: int = 3
    scale: float = 1.0
    unit: str = ""
    task: str = ""

    @property
    def file_key(self) -> str:
        """Name in CSV files, which marks values in other units than those of `per_frame.csv`."""
        return f"{self.key}_percent" if self.scale == 100 else self.key

    def text(self, value: float) -> str:
        """Format a number as it is printed."""
        return f"{value:.{self.decimals}f}"


@dataclass(frozen=True)
class Cell:
    """Our number in the column's unit with its uncertainty, and the paper's number."""

    value: float | None = None
    std: float | None = None
    low: float | None = None
    high: float | None = None
    paper: float | None = None
    paper_std: float | None = None


@dataclass(frozen=True)
class Line:
    """A row: texts under the table's heads, then cells under its columns."""

    heads: tuple[str, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        name: name of its files.
        heads: headings of the leading columns of text.
        grouped: whether rows compete only with those of the same first text.
    """

    name: str
    title: str
    caption: str
    heads: tuple[str, ...]
    columns: tuple[Column, ...]
    rows: tuple[Line, ...]
    notes: tuple[str, ...] = ()
    grouped: bool = False


ARROWS = {"lower": "down", "higher": "up", None: ""}


def column_of(spec: MetricSpec) -> Column:
    """A metric's column, in the units that are printed."""
    better = ARROWS[spec.better]
    return Column(
        spec.name, spec.title, spec.latex, better, spec.decimals, spec.scale, spec.unit, task=spec.task
    )


METRICS = {name: column_of(spec) for name, spec in OURS.items()}
"""Columns of our metrics by name, in the paper's order and units."""


def signed(column: Column) -> Column:
    """The column for differences, in which no row is best."""
    return replace(column, better="")


def marks(table: Table) -> list[list[str]]:
    """`best`, `second` or nothing for each cell, by what is printed: equal numbers are marked alike."""
    result = [["" for _ in table.columns] for _ in table.rows]
    groups: dict[str, list[int]] = {}
    for i, row in enumerate(table.rows):
        groups.setdefault(row.heads[0] if table.grouped else "", []).append(i)
    for members in groups.values():
        for j, column in enumerate(table.columns):
            for i, mark in _ranked(table, members, j, column).items():
                result[i][j] = mark
    return result


def _ranked(table: Table, members: list[int], j: int, column: Column) -> dict[int, str]:
    values = {i: table.rows[i].cells[j].value for i in members}
    printed = {i: float(column.text(value)) for i, value in values.items() if value is not None}
    if len(printed) < 2 or not column.better:
        return {}
    order = sorted(set(printed.values()), reverse=column.better == "up")
    names = dict(zip(order, ("best", "second"), strict=False))
    return {i: names[value] for i, value in printed.items() if value in names}
