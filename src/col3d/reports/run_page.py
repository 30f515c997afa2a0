"""Write the page of a run: scores, training curves and panels in one self-contained HTML file.

`python -m col3d.reports.run_page runs/default` writes it anew from the run's own files.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml
from markupsafe import Markup

from col3d.errors import UserError
from col3d.io.atomic import write_whole
from col3d.io.ownership import Owned
from col3d.io.run_files import TRAINING
from col3d.io.run_schemas import read_object
from col3d.reports.figures.figure_data import Method
from col3d.reports.figures.style import BLACK, Style
from col3d.reports.figures.training_curves import curves, draw_methods
from col3d.reports.places import command_without_places, without_places
from col3d.reports.runs import Run
from col3d.reports.scenes import Scene, read_frame
from col3d.reports.summary import on_screen, rows_of
from col3d.reports.templating import data_uri, filled

PAGE = "run.html"


def write_run_page(folder: Path) -> Path:
    """Write `run.html` into the folder of a run or an evaluation.

    Args:
        folder: folder with summary.json, and other files of a run.

    Returns:
        Path of the page.

    Raises:
        UserError: the folder holds no finished run.
    """
    summary = _read_summary(folder)
    config = folder / "config.yaml"
    try:
        options = yaml.safe_load(config.read_text(encoding="utf-8")) if config.is_file() else {}
    except yaml.YAMLError:
        raise UserError(f"{config}: not YAML") from None
    place = folder / "panels"
    panels = sorted(place.rglob("*.png"))
    shown = without_places(summary)
    if summary.get("command"):
        shown["command"] = command_without_places(summary["command"])
    facts = {
        "title": "{model} on {data}, {split} split, seed {seed}".format(**summary),
        "summary": shown,
        "tables": _tables(summary),
        "curves": _curves(Run(folder, options, summary, {}, folder.name)),
        "panels": [(_name_below(place, path), data_uri(path)) for path in panels],
        "scenes": as_script([read_frame(path) for path in sorted(place.rglob("*.npz"))]),
        "config": yaml.safe_dump(without_places(options), sort_keys=False) if options else "",
    }
    return write_page(folder / PAGE, "run.html", facts)


def _name_below(folder: Path, path: Path) -> str:
    return path.relative_to(folder).with_suffix("").as_posix()


def write_page(path: Path, template: str, facts: dict[str, Any]) -> Path:
    """Render a template and write the page in one step."""
    write_whole(path, filled(template, facts))
    return path


def as_script(scenes: Sequence[Scene]) -> Markup | None:
    """Scenes that have points, as JSON inside a script; None if there are none."""
    shown = [scene for scene in scenes if len(scene.clouds[0].points)]
    text = json.dumps([scene.plain() for scene in shown]).replace("<", "\\u003c")
    return Markup(text) if shown else None


def _read_summary(folder: Path) -> dict[str, Any]:
    try:
        return read_object(folder / "summary.json")
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise UserError(f"{folder}: no finished run, summary.json is missing or broken ({why})") from None


def _tables(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Headings and rows of the table of depth, and of that of normals where they were measured."""
    return [
        {
            "title": task.capitalize(),
            "headings": ["video", "frames", *(spec.screen_title for spec in metrics)],
            "rows": rows_of(summary, metrics),
        }
        for task, metrics in on_screen(summary).items()
        if any(spec.name in summary["metrics"] for spec in metrics)
    ]


def _curves(run: Run) -> str | None:
    """A picture of the training's curves as a data URI; None where no curves were kept."""
    if not curves(run):
        return None
    with TemporaryDirectory() as place:
        path = Path(place) / "curves.png"
        draw_methods(
            path, [Method(str(run.summary["model"]), (run,), Style(str(run.summary.get("colour") or BLACK)))]
        )
        return data_uri(path)


if __name__ == "__main__":
    try:
        for given in sys.argv[1:] or ["runs/default"]:
            owned = [Owned(Path(given), kind, "FOLDER") for kind in (TRAINING, "evaluation")]
            next((one for one in owned if PAGE in one.names), owned[0]).claim(PAGE)
            print(write_run_page(Path(given)))
    except (UserError, ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
