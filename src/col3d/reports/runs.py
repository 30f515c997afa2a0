"""Read the finished runs below a folder, and the reason why each other one is left out."""

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from col3d.io.run_schemas import misfit
from col3d.registry.earlier import NAMES, updated
from col3d.registry.metric_specs import MetricSpec, unknown
from col3d.reports.per_frame import PIXELS, metrics_in, read_per_frame
from col3d.reports.summary import specs_of

CONFIG, SUMMARY, TABLE = "config.yaml", "summary.json", "per_frame.csv"
FACTS = ("model", "seed", "data", "split", "protocol", "split_name", "frames")
SAME = ("model", "seed", "data", "split", "protocol")
"""Columns that hold one value in a table of one run."""
TEXT = ("video", "segment")
FOREIGN = {"wandb", "checkpoints", "panels", "predictions"}
"""Folders of a run that hold no run, though W&B keeps a config.yaml of its own."""
Frames = dict[str, np.ndarray]
"""Columns of equal length: video, segment (text), frame (int), pixels, metrics (float, NaN where empty).

Metrics are those of the table: `Run.values` has NaN for others."""


@dataclass(frozen=True)
class Run:
    """Files of a run, or of a later evaluation of its best weights.

    Attributes:
        folder: folder with summary.json and per_frame.csv.
        options: content of the training's config.yaml.
        summary: content of summary.json.
        frames: per_frame.csv by column, in the order of videos and frames.
        name: path of the folder relative to the one that was searched.
    """

    folder: Path
    options: dict[str, Any]
    summary: dict[str, Any]
    frames: Frames
    name: str

    def values(self, metric: str) -> np.ndarray:
        """A metric of each frame; NaN where the frame, or the whole table, does not have it."""
        column = self.frames.get(metric)
        return np.full(len(self.frames["frame"]), np.nan) if column is None else column

    @property
    def specs(self) -> dict[str, MetricSpec]:
        """Specs of the metrics: ours, those of plugins that the run recorded, and of its other columns."""
        specs = specs_of(self.summary)
        columns = [name for name in self.frames if name not in (*TEXT, "frame", PIXELS)]
        return {**specs, **{name: unknown(name) for name in columns if name not in specs}}


@dataclass(frozen=True)
class Found:
    """Runs in the order of their names, and a line for each folder that is left out."""

    runs: tuple[Run, ...]
    left_out: tuple[str, ...]


class _UnusableError(Exception):
    """Reason why a folder is left out."""


def read_runs(root: Path) -> Found:
    """Read every run below a folder, and the evaluations inside runs.

    A folder with config.yaml is a run; a folder inside it with summary.json is an evaluation of its weights.
    """
    runs, left_out = [], []
    for folder in _folders(root):
        name = root.name if folder == root else str(folder.relative_to(root))
        try:
            runs.append(_read(folder, root, name))
        except _UnusableError as error:
            left_out.append(f"{name}: {error}")
    return Found(tuple(runs), tuple(left_out))


def _folders(root: Path) -> Iterator[Path]:
    """Folders that are a run or an evaluation, or look like one."""
    holding = {path.parent for name in (CONFIG, SUMMARY) for path in root.rglob(name)}
    for folder in sorted(holding):
        parts = folder.relative_to(root).parts
        if not any(part in FOREIGN or part.startswith(".") for part in parts):
            yield folder


def _read(folder: Path, root: Path, name: str) -> Run:
    home = _home(folder, root)
    if not (folder / SUMMARY).is_file():
        raise _UnusableError(f"not finished, {SUMMARY} is missing")
    if home != folder and not (home / SUMMARY).is_file():
        raise _UnusableError(f"an evaluation of {home.name}, which is not finished")
    options, summary = _options(home / CONFIG), _summary(folder / SUMMARY)
    if home != folder and Path(str(summary.get("checkpoint"))).stem != "best":
        raise _UnusableError(f"scores {summary.get('checkpoint')}, not the best weights of its run")
    return Run(folder, options, summary, _frames(folder / TABLE, summary), name)


def _home(folder: Path, root: Path) -> Path:
    """The nearest folder upwards with a config.yaml."""
    for place in (folder, *folder.parents):
        if (place / CONFIG).is_file():
            return place
        if place == root:
            break
    raise _UnusableError(f"{SUMMARY} without a {CONFIG}: what was trained is not known")


def _options(path: Path) -> dict[str, Any]:
    try:
        options = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        raise _UnusableError(f"{CONFIG} cannot be read") from None
    groups = ("model", "loss", "data")
    if not isinstance(options, dict) or not all(isinstance(options.get(group), dict) for group in groups):
        raise _UnusableError(f"{CONFIG} is not that of a run: {', '.join(groups)} are needed")
    return updated({str(key): value for key, value in options.items()})


def _summary(path: Path) -> dict[str, Any]:
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        raise _UnusableError(f"{SUMMARY} is half written or broken") from None
    missing = [fact for fact in FACTS if not isinstance(summary, dict) or fact not in summary]
    if missing:
        raise _UnusableError(f"{SUMMARY} lacks {', '.join(missing)}")
    if wrong := misfit(SUMMARY, summary):
        raise _UnusableError(f"{SUMMARY} is broken: {wrong}")
    return {**summary, "protocol": NAMES.get(str(summary["protocol"]), summary["protocol"])}


def _frames(path: Path, summary: dict[str, Any]) -> Frames:
    try:
        rows = read_per_frame(path)
        rows.sort(key=lambda row: (row["video"], int(row["frame"])))
        text = {name: np.array([row[name] for row in rows], str) for name in TEXT}
        known = specs_of(summary)
        numbers = {PIXELS: _numbers(rows, PIXELS)}
        for metric in metrics_in(rows):
            if metric in known or _is_numeric(rows, metric):
                numbers[metric] = _numbers(rows, metric)
        frames = {**text, "frame": np.array([int(row["frame"]) for row in rows], np.int64), **numbers}
    except FileNotFoundError:
        raise _UnusableError(f"not finished, {TABLE} is missing") from None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise _UnusableError(f"{TABLE} cannot be read: {str(error).rpartition(': ')[2]}") from None
    _check(rows, frames, summary)
    return frames


def _numbers(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row.get(name) or "nan") for row in rows])


def _is_numeric(rows: list[dict[str, str]], name: str) -> bool:
    """Whether a column without a known spec may be a metric: all are numbers, at least one is finite."""
    try:
        return bool(np.isfinite(_numbers(rows, name)).any())
    except ValueError:
        return False


def _check(rows: list[dict[str, str]], frames: Frames, summary: dict[str, Any]) -> None:
    """Refuse a table that is truncated, of several runs, or with values that are not finite."""
    if len(rows) != summary["frames"] or not rows:
        raise _UnusableError(f"{TABLE} has {len(rows)} frames, {SUMMARY} says {summary['frames']}")
    for name in SAME:
        if others := {row[name] for row in rows} - {str(summary[name])}:
            raise _UnusableError(
                f"{TABLE} has {name} {', '.join(sorted(others))}, {SUMMARY} has {summary[name]}"
            )
    twice = [key for key, n in Counter((row["video"], row["frame"]) for row in rows).items() if n > 1]
    if twice:
        raise _UnusableError(f"{TABLE} has frame {twice[0][1]} of {twice[0][0]} twice")
    _check_finite(rows, frames, [name for name, spec in specs_of(summary).items() if not spec.undefined])


def _check_finite(rows: list[dict[str, str]], frames: Frames, metrics: list[str]) -> None:
    """Refuse metrics that are not finite, except those that a frame need not have."""
    measured = [name for name in metrics if name in frames]
    if not measured:
        return
    given = np.array([[row.get(name) not in ("", None) for name in measured] for row in rows])
    broken = given & ~np.isfinite(np.stack([frames[name] for name in measured], axis=1))
    if broken.any():
        row, column = np.argwhere(broken)[0]
        where = f"frame {rows[row]['frame']} of {rows[row]['video']}"
        raise _UnusableError(f"{measured[column]} is not finite in {where} ({broken.sum()} values in all)")
