"""Options of trainings as the command line composes them."""

from col3d.app.config import TrainOptions
from col3d.cli.program import composed
from col3d.refusals import check_options


def train_options(*overrides: str) -> TrainOptions:
    """What `train.py` takes with these overrides."""
    return check_options(TrainOptions, composed("train", [*overrides, "output_dir=runs"]))
