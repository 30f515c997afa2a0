"""LightningModules, one for each way of training: supervised and adversarial."""

from col3d.training.tasks.adversarial import AdversarialTask
from col3d.training.tasks.supervised import SupervisedTask

__all__ = ["AdversarialTask", "SupervisedTask"]
