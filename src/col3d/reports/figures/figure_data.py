"""Data of figures: the methods to compare, their predictions, and the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from col3d.io.predictions import StoredPredictions, read_facts
from col3d.reports.compose import title_of
from col3d.reports.experiments import Experiment, SeedGroup, experiments_of, label_of
from col3d.reports.figures.figure import MissingError
from col3d.reports.figures.style import Look, Style, styles_of
from col3d.reports.runs import Found, Run
from col3d.reports.setting import Setting

IN_PICTURES, IN_PLOTS = 5, 8
"""Most methods in one figure."""


@dataclass(frozen=True)
class Method:
    """A row of a table, and the style in which it is drawn."""

    label: str
    runs: tuple[Run, ...]
    style: Style

    @property
    def shown(self) -> Run:
        """The run whose maps are drawn: the first with predictions, or the first of all."""
        return next(filter(has_predictions, self.runs), self.runs[0])

    def mean(self, metric: str) -> float:
        """Mean of a metric over the frames of all seeds that have a value; NaN where none has."""
        values = np.concatenate([run.values(metric) for run in self.runs])
        values = values[np.isfinite(values)]
        return float(values.mean()) if len(values) else float("nan")


@dataclass(frozen=True)
class Group:
    """Methods that were scored in one setting.

    Attributes:
        title: title of their table.
    """

    title: str
    setting: Setting
    methods: tuple[Method, ...]

    def with_predictions(self) -> tuple[Method, ...]:
        """The methods whose maps can be drawn.

        Raises:
            MissingError: there is none.
        """
        having = tuple(method for method in self.methods if any(map(has_predictions, method.runs)))
        if not having:
            raise MissingError(
                f"no run of {', '.join(method.label for method in self.methods)} has predictions "
                "(callbacks.predictions=true keeps them)"
            )
        return having

    def best(self, among: Sequence[Method]) -> Method:
        """The method of the lowest mean abs_rel."""
        return min(among, key=lambda method: np.nan_to_num(method.mean("abs_rel"), nan=np.inf))


@dataclass(frozen=True)
class FigureData:
    """Data of all figures.

    Attributes:
        main: the benchmark, or where there is none to compare, all methods in the setting of the first table.
        groups: every table by its name.
        truth: images, true depth and normals, where they are kept.
    """

    main: Group
    groups: dict[str, Group]
    truth: StoredPredictions | None

    def known_truth(self) -> StoredPredictions:
        """The stored truth.

        Raises:
            MissingError: it is not kept.
        """
        if self.truth is None:
            raise MissingError("the folder with images and true depth was not given or is not complete")
        return self.truth


def figure_data_of(collected: Found, truth: Path | None) -> FigureData:
    """Group runs as tables do and open the truth."""
    experiments = experiments_of(collected)
    styles = styles_of({row.label: look_of(row) for e in experiments for row in e.rows})
    groups = {e.name: _group(e.rows, e, styles) for e in experiments}
    first = experiments[0]
    if first.name == "benchmark" and len(first.rows) > 1:
        main = groups["benchmark"]
    else:
        same = [row for e in experiments if e.setting == first.setting for row in e.rows]
        main = _group(list({row.runs[0].folder: row for row in reversed(same)}.values())[::-1], first, styles)
    return FigureData(main, groups, _open(truth))


def look_of(row: SeedGroup) -> Look:
    """Look of a row: its network, and the network's colour where a run recorded one."""
    colours = (str(run.summary.get("colour") or "") for run in row.runs)
    return Look(label_of(row.runs[0]), next(filter(None, colours), ""))


def _group(rows: Sequence[SeedGroup], experiment: Experiment, styles: dict[str, Style]) -> Group:
    methods = tuple(Method(row.label, row.runs, styles[row.label]) for row in rows[:IN_PLOTS])
    return Group(title_of(experiment), experiment.setting, methods)


def _open(truth: Path | None) -> StoredPredictions | None:
    try:
        return None if truth is None else StoredPredictions(truth)
    except ValueError:
        return None


def predictions_folder(run: Run) -> Path:
    """Folder in which a training with `callbacks.predictions` keeps its predictions."""
    return run.folder / f"predictions_{run.summary['split']}"


def has_predictions(run: Run) -> bool:
    """Whether a run's predictions exist and are complete."""
    return read_facts(predictions_folder(run)) is not None
