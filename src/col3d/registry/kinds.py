"""The registries, one for each kind of part."""

from pydantic import Field

from col3d.registry.parts import Registry

MODELS = Registry(
    "model",
    ("col3d.models",),
    "model.name",
    "model",
    groups={"model": "col3d.models.options:node"},
    supplied=("size_hw",),
    taken=("name", "freeze", "unfreeze_at"),
)
LOSSES = Registry(
    "loss",
    ("col3d.losses.terms",),
    "loss.terms",
    "loss.terms.ENTRY",
    supplied=("prediction", "batch", "max_depth"),
    taken=("term", "from_epoch"),
)
BALANCERS = Registry(
    "balancer",
    ("col3d.losses.balance",),
    "loss.balance.name",
    "loss.balance",
    groups={"loss/balance": "col3d.losses.options:balance_node"},
    taken=("name",),
)
METRICS = Registry(
    "metric",
    ("col3d.metrics.registered",),
    "metrics",
    "metrics.{name}",
    supplied=("preds", "target", "mask", "min_depth", "max_depth", "cosine_epsilon"),
)
OPTIMIZERS = Registry(
    "optimizer",
    ("col3d.training.optimizers", "col3d.training.timm_optimizers"),
    "optimizer.name",
    "optimizer",
    groups={"optimizer": "col3d.training.optimizers:node"},
    supplied=("params",),
    taken=("name", "decoder_weight_decay", "encoder_lr", "layer_decay"),
    rules={
        "weight_decay": Field(ge=0),
        "eps": Field(gt=0),
        "momentum": Field(ge=0, lt=1),
    },
)
DATASETS = Registry(
    "dataset",
    ("col3d.data.datasets.registered",),
    "data.name",
    "data",
    groups={"data": "col3d.data.options:node", "data/source": "col3d.data.options:source_node"},
    supplied=("root", "videos", "normals", "camera", "truth", "rendered"),
    taken=(
        *("name", "split", "allow_missing", "store", "weight"),
        *("size", "batch_size", "workers", "augment", "test", "also"),
    ),
)
COUNTS = ("total_steps", "total_iters", "T_max")
"""Parameters of schedules that default to the length of the training."""
SCHEDULERS = Registry(
    "scheduler",
    ("col3d.training.schedulers",),
    "scheduler.name",
    "scheduler",
    groups={"scheduler": "col3d.training.schedulers:node"},
    supplied=("optimizer", "training", "last_epoch", *COUNTS),
    taken=("name", "interval"),
)
CALLBACKS = Registry(
    "callback",
    ("col3d.training.callbacks.named",),
    "callbacks.more",
    "callbacks.more.ENTRY",
    taken=("callback",),
)
LOGGERS = Registry(
    "logger",
    ("col3d.runs.loggers",),
    "logger",
    "logger.{name}",
    groups={"logger": "col3d.runs.logger_options:node"},
    supplied=("folder", "run", "config"),
)
KINDS = {
    registry.kind: registry
    for registry in (MODELS, LOSSES, BALANCERS, METRICS, DATASETS, OPTIMIZERS, SCHEDULERS, CALLBACKS, LOGGERS)
}
GROUPS = {group: registry for registry in KINDS.values() for group in registry.groups}
"""Groups of options whose choices are registered parts."""
