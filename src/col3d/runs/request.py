"""The run that is asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from col3d.registry.schema import Options


@dataclass(frozen=True)
class RunRequest:
    """The run that is asked for, as far as its folder has to know it.

    Attributes:
        path: of the folder.
        options: all of them; what is written into config.yaml.
        completed: options of an earlier run -> the same with the defaults of those that came since.
        overwrite: whether another run may be replaced.
        epochs: of the whole training.
        can_be_longer: whether a finished run may be given more epochs.
        schedule: of the learning rate, which goes on over more epochs; empty where it is constant.
        weight_files: by option, files that the training begins from.
        panels: how many pictures are asked for.
        predictions: whether those of the test split are kept.
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
        """The options as JSON and YAML hold them."""
        return self.options.model_dump(mode="json")
