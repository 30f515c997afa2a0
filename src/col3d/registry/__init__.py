"""Registries of the parts of an experiment, by name: networks, losses, metrics, data sets and more.

A part's signature is its schema: the parameters are the options, their defaults are the only defaults.
"""

from col3d.registry.describe import available, describe
from col3d.registry.kinds import (
    BALANCERS,
    CALLBACKS,
    COUNTS,
    DATASETS,
    GROUPS,
    KINDS,
    LOGGERS,
    LOSSES,
    METRICS,
    MODELS,
    OPTIMIZERS,
    SCHEDULERS,
)
from col3d.registry.parts import Part, Registry
from col3d.registry.register import (
    register_balancer,
    register_callback,
    register_dataset,
    register_logger,
    register_loss,
    register_metric,
    register_metrics,
    register_model,
    register_optimizer,
    register_scheduler,
)

__all__ = [
    "BALANCERS",
    "CALLBACKS",
    "COUNTS",
    "DATASETS",
    "GROUPS",
    "KINDS",
    "LOGGERS",
    "LOSSES",
    "METRICS",
    "MODELS",
    "OPTIMIZERS",
    "SCHEDULERS",
    "Part",
    "Registry",
    "available",
    "describe",
    "register_balancer",
    "register_callback",
    "register_dataset",
    "register_logger",
    "register_loss",
    "register_metric",
    "register_metrics",
    "register_model",
    "register_optimizer",
    "register_scheduler",
]
