"""LightningModules, one for each way of optimising."""

from col3d.tasks.adversarial import AdversarialTask
from col3d.tasks.supervised import SupervisedTask

__all__ = ["AdversarialTask", "SupervisedTask"]
