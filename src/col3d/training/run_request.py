"""Conversion of a training's options to the `RunRequest` that its folder needs."""

from pathlib import Path
from typing import Any

from col3d.errors import UserError
from col3d.models.options import file_of_weights
from col3d.registry.earlier import updated
from col3d.registry.refusals import check_options
from col3d.runs.request import RunRequest
from col3d.training.options import TrainOptions
from col3d.training.schedulers import is_of_length


def run_request(options: TrainOptions) -> RunRequest:
    """Describe the run that checked options request."""
    scheduler = options.scheduler
    return RunRequest(
        path=Path(options.output_dir),
        options=options,
        completed=_completed,
        overwrite=options.overwrite,
        epochs=options.trainer.max_epochs,
        can_be_longer=not is_of_length(scheduler),
        schedule="" if scheduler.name == "constant" else scheduler.name,
        weight_files=weight_files(options),
        panels=options.callbacks.panels,
        predictions=options.callbacks.predictions,
    )


def weight_files(options: TrainOptions) -> dict[str, str]:
    """Return the files of weights that a training begins from, by the option that names them."""
    named = {"init.checkpoint": options.init.checkpoint, "model.pretrained": file_of_weights(options.model)}
    return {option: str(name) for option, name in named.items() if name}


def _completed(before: dict[str, Any]) -> dict[str, Any]:
    """Add the defaults of options that an earlier run lacks to its options."""
    before = updated(before)
    try:
        return check_options(TrainOptions, before).model_dump(mode="json")
    except UserError:
        return before
