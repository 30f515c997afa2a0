"""Results that are on disk as soon as they are there: JSON lines, and tables in Markdown made of them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Record = dict[str, Any]
"""One line of a table by its columns; `table` is the heading. Lists are for JSON alone."""
STAGES = "Stages"
LINES, TABLES, ERRORS = "results.jsonl", "gpu.md", "errors.txt"


class Results:
    """Files of results in a folder; those of a run before are replaced.

    Args:
        folder: where they go.
        facts: what the numbers depend on, by name.
    """

    def __init__(self, folder: Path, facts: Mapping[str, Any]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (LINES, TABLES, ERRORS):
            (folder / name).unlink(missing_ok=True)
        self.folder, self.facts = folder, facts
        self.tables: dict[str, list[Record]] = {}
        self._append(LINES, json.dumps({"table": "facts", **facts}))

    def add(self, record: Record) -> None:
        """Write a line, and the tables anew."""
        self._append(LINES, json.dumps(record))
        self.tables.setdefault(record["table"], []).append(record)
        (self.folder / TABLES).write_text(self.markdown(), encoding="utf-8")

    def add_error(self, text: str) -> None:
        """Write what a stage ended with in full."""
        self._append(ERRORS, text)

    def markdown(self) -> str:
        """All tables under the facts."""
        facts = "; ".join(f"{name} {value}" for name, value in self.facts.items())
        titles = sorted(self.tables, key=lambda title: title == STAGES)  # how stages ended comes last
        parts = [f"{facts}.", *(_table(title, self.tables[title]) for title in titles)]
        return "\n\n".join(parts) + "\n"

    def _append(self, name: str, text: str) -> None:
        with (self.folder / name).open("a", encoding="utf-8") as file:
            file.write(f"{text}\n")


def _table(title: str, rows: list[Record]) -> str:
    columns = list(dict.fromkeys(name for row in rows for name in row if _shown(name, row[name])))
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    lines += [f"| {' | '.join(_cell(row.get(name)) for name in columns)} |" for row in rows]
    return "\n".join([f"{title}:", "", *lines])


def _shown(name: str, value: Any) -> bool:
    return name != "table" and not isinstance(value, list | dict)


def _cell(value: Any) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "met" if value else "**missed**"
        case float():
            return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value).replace("|", "/")
