"""What watches a training and writes its results."""

from col3d.callbacks.epoch_lines import EpochLines
from col3d.callbacks.finite_numbers import FiniteCheckpoint, FiniteNumbers
from col3d.callbacks.panels import ImagePanels
from col3d.callbacks.per_frame import PerFrameTable
from col3d.callbacks.save_predictions import SavePredictions

__all__ = [
    "EpochLines",
    "FiniteCheckpoint",
    "FiniteNumbers",
    "ImagePanels",
    "PerFrameTable",
    "SavePredictions",
]
