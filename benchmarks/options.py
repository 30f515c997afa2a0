"""Options of trainings as the command line composes them."""

from hydra import initialize_config_dir

from col3d.app.config import TrainOptions
from col3d.cli.files import CONF
from col3d.cli.program import composed
from col3d.refusals import check_options


def train_options(*overrides: str) -> TrainOptions:
    """What `train.py` takes with these overrides."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return check_options(TrainOptions, composed("train", [*overrides, "output_dir=runs"]))
