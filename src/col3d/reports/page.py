"""Write a report: one self-contained HTML page, the same as Markdown, and each table as files."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from col3d.io.atomic import write_whole
from col3d.reports import render
from col3d.reports.breakdowns import cost_table, segment_table, video_table
from col3d.reports.compose import PHANTOM, difference_tables, further_table, main_table, title_of
from col3d.reports.experiments import Experiment
from col3d.reports.places import command_without_places, last_name, without_places
from col3d.reports.runs import Found, Run
from col3d.reports.tables import Table
from col3d.reports.templating import filled

NOT_RECORDED = "not recorded"
PAGES = ("report.html", "report.md")
FORMATS = {"md": render.markdown, "tex": render.latex, "csv": render.comma_separated}
"""Renderers of tables by file ending."""
BY_PART = ("benchmark", "ablation")
"""Experiments that are also shown by segment and by video."""


@dataclass(frozen=True)
class Picture:
    """A figure of the report.

    Attributes:
        path: PNG or SVG file inside the report's folder.
    """

    title: str
    caption: str
    path: Path


def tables_of(experiments: Sequence[Experiment]) -> list[Table]:
    """Every table of a report, in its order."""
    tables: list[Table | None] = []
    for experiment in experiments:
        tables += [main_table(experiment), further_table(experiment), *difference_tables(experiment)]
        if experiment.name in BY_PART:
            tables += [segment_table(experiment), video_table(experiment)]
    return [table for table in (*tables, cost_table(experiments)) if table is not None]


def write_report(
    out: Path,
    collected: Found,
    experiments: Sequence[Experiment],
    pictures: Sequence[Picture],
    not_drawn: Sequence[str],
    source: str,
) -> list[Path]:
    """Write report.html, report.md and tables/ into a folder.

    Args:
        out: the folder; made where it is not there.
        collected: runs and left-out folders, for the sections on both.
        experiments: source of the tables.
        pictures: figures, already drawn.
        not_drawn: a line for each figure that was not drawn, with the reason.
        source: the folder that was searched, as the page names it.

    Returns:
        Paths of the files that were written.
    """
    tables = tables_of(experiments)
    facts = {
        "source": last_name(source) if Path(source).is_absolute() else without_places(source),
        "tables": tables,
        "pictures": pictures,
        "not_drawn": without_places(not_drawn),
        "runs": [_facts(run) for run in collected.runs],
        "left_out": without_places([*collected.left_out, *_not_in_tables(experiments)]),
        "phantom": PHANTOM if any(e.setting.data == "phantom" for e in experiments) else "",
        "versions": f"Python {platform.python_version()}",
        "out": out,
    }
    written = _write_tables(out / "tables", tables)
    for name in PAGES:
        text = filled(name, facts)
        write_whole(out / name, text)
    return [*(out / name for name in PAGES), *written, *(picture.path for picture in pictures)]


def _not_in_tables(experiments: Sequence[Experiment]) -> list[str]:
    return [f"{title_of(experiment)}: {line}" for experiment in experiments for line in experiment.left_out]


def _write_tables(folder: Path, tables: Sequence[Table]) -> list[Path]:
    """Each table as Markdown, LaTeX and CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for table in tables:
        for ending, write in FORMATS.items():
            written.append(folder / f"{table.name}.{ending}")
            write_whole(written[-1], write(table))
    return written


def names_of(experiments: Sequence[Experiment]) -> list[str]:
    """Names of the files that `write_report` writes, without the pictures."""
    tables = [f"tables/{table.name}.{ending}" for table in tables_of(experiments) for ending in FORMATS]
    return [*PAGES, *tables]


def _facts(run: Run) -> dict[str, Any]:
    """Facts of one run for the page's section on runs."""
    summary = run.summary
    versions = summary.get("versions") or {}
    best = summary.get("best") or {}
    return {
        "name": run.name,
        "about": f"{summary['model']}, seed {summary['seed']}, {summary['data']}, {summary['split']} part, "
        f"protocol {summary['protocol']}, {summary['frames']} frames",
        "command": command_without_places(summary.get("command") or NOT_RECORDED),
        "commit": summary.get("commit") or NOT_RECORDED,
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()) or NOT_RECORDED,
        "best": ", ".join(f"{name} {value:.4g}" for name, value in best.items() if value is not None),
        "config": yaml.safe_dump(without_places(run.options), sort_keys=False),
    }
