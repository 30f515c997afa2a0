"""The description of a requested run, as its folder needs it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from col3d.registry.schema import Options


@dataclass(frozen=True)
class RunRequest:
    """A requested run, as far as its folder has to know it.

    Attributes:
        path: path of the run's folder.
        options: all options, which are written to config.yaml.
        completed: function that adds the defaults of options which an earlier run lacks.
        overwrite: whether another run may be replaced.
        epochs: number of epochs of the whole training.
        can_be_longer: whether a finished run may be given more epochs.
        schedule: name of the learning rate's schedule, for messages; empty if it is constant.
        weight_files: files that the training begins from, by option.
        panels: number of pictures.
        predictions: whether predictions of the test split are stored.
    """

    path: Path
    options: Options
    completed: Callable[[dict[str, Any]], dict[str, Any]]
    overwrite: bool
    epochs: int
    can_be_longer: bool
    schedule: str
    weight_files: Mapping[str, str]
    panels: int
    predictions: bool

    def plain(self) -> dict[str, Any]:
        """Return the options as plain values for JSON and YAML."""
        return self.options.model_dump(mode="json")
