"""Options of trainings as the command line composes them."""

from col3d.cli.program import composed
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions


def train_options(*overrides: str) -> TrainOptions:
    """What `train.py` takes with these overrides."""
    return check_options(TrainOptions, composed("train", [*overrides, "output_dir=runs"]))
