"""What watches a training and writes its results."""

from col3d.callbacks.checkpoints import About, BestCheckpoint, LastCheckpoint
from col3d.callbacks.epoch_lines import EpochLines
from col3d.callbacks.finite_numbers import FiniteNumbers
from col3d.callbacks.panels import ImagePanels
from col3d.callbacks.per_frame import PerFrameTable
from col3d.callbacks.save_predictions import SavePredictions
from col3d.callbacks.stop_signals import Stopped, StopSignals

__all__ = [
    "About",
    "BestCheckpoint",
    "EpochLines",
    "FiniteNumbers",
    "ImagePanels",
    "LastCheckpoint",
    "PerFrameTable",
    "SavePredictions",
    "StopSignals",
    "Stopped",
]
