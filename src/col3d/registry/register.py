"""The doors: a decorator, or a plain call, for each kind of part."""

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from col3d.registry.kinds import (
    BALANCERS,
    CALLBACKS,
    DATASETS,
    LOGGERS,
    LOSSES,
    METRICS,
    MODELS,
    OPTIMIZERS,
    SCHEDULERS,
)
from col3d.registry.metric_specs import MetricSpec, checked_spec
from col3d.registry.parts import NOTHING, Built


def register_model(
    name: str,
    build: Built | None = None,
    *,
    loss: str = "silog",
    task: str = "supervised",
    predicts: tuple[str, ...] = ("depth",),
    depth_alone: str | None = None,
    presets: Mapping[str, Mapping[str, Any]] = NOTHING,
    label: str = "",
    colour: str = "",
) -> Any:
    """Register a network: any `nn.Module` that maps (image, rays) to a `Prediction`.

    Args:
        name: for `model=NAME` on the command line, and for `create`.
        build: the class, or a function that makes the network. A parameter `size_hw` is given the height and
            width of the frames.
        loss: the file of `conf/loss` that it trains with unless another is named.
        task: the file of `conf/task` likewise.
        predicts: what it predicts by itself, of "depth" and "normals".
        depth_alone: name of the network that is this one without normals, for hints.
        presets: defaults of options at a `preset`, where they differ from the signature's.
        label: how reports call it; its name where it is empty.
        colour: of its lines in figures, as "#RRGGBB"; where it is empty, reports choose one.

    Raises:
        ValueError: besides what `Registry.register` says, the label is no line or the colour is no colour.
    """
    if not label.isprintable():
        raise ValueError(f"register_model: {name}: label: expected one line, got {label!r}")
    if colour and not re.fullmatch("#[0-9A-Fa-f]{6}", colour):
        raise ValueError(f"register_model: {name}: colour: expected #RRGGBB, got {colour!r}")
    facts = {"predicts": predicts, "depth_alone": depth_alone, "presets": presets}
    facts |= {"label": label, "colour": colour}
    return MODELS.register(name, build, {"loss": loss, "task": task}, **facts)


def register_loss(
    name: str,
    build: Built | None = None,
    *,
    needs: tuple[str, ...] = ("depth",),
    truth: tuple[str, ...] = (),
) -> Any:
    """Register a term of a loss: a function (prediction, batch, and its options) -> scalar.

    Args:
        name: for `loss.terms.<entry>=NAME`.
        build: the function. It is zero at the truth, and gives pixels outside of `batch["mask"]` no gradient.
            A parameter `max_depth` is given the network's maximum depth in mm.
        needs: what the network has to predict for it, of "depth" and "normals".
        truth: what has to be known for it beside depth: "normals".
    """
    return LOSSES.register(name, build, needs=needs, truth=truth)


def register_metric(
    name: str,
    build: Built | None = None,
    *,
    task: str = "depth",
    better: str | None = None,
    **said: Any,
) -> Any:
    """Register a metric: a function (preds, target, mask, and its options) -> one value a frame, (b,).

    Depth is (b, 1, h, w) in mm, normals are unit (b, 3, h, w), the mask is (b, 1, h, w), True where a pixel
    counts. Predictions are raised to 0.001 mm and cut at the upper end of the protocol's range, unless the
    function has parameters `min_depth` and `max_depth`, which are then given. NaN says that a frame has no
    such value: its cell stays empty, and it is in no mean.

    Args:
        name: of its column, and for `metrics.NAME.OPTION=VALUE`.
        build: the function.
        task: what it is given, "depth" or "normals".
        better: "lower", "higher", or None where neither is.
        said: what else files and tables need to know, such as unit and heading; see `MetricSpec`.

    Raises:
        ValueError: a word is unknown, or the name is that of another column.
    """
    spec = checked_spec(MetricSpec(name, task, better, **said))
    return METRICS.register(name, build, spec=spec)


def register_metrics(specs: Iterable[MetricSpec], build: Built) -> Built:
    """Register metrics that one function computes together: it returns a dict of (b,) by name."""
    for spec in specs:
        METRICS.register(spec.name, build, spec=checked_spec(spec))
    return build


def register_balancer(name: str, build: Built | None = None) -> Any:
    """Register a balancer: a class that is called with the terms of a batch and gives what is minimised.

    Args:
        name: for `loss/balance=NAME`.
        build: the class. What it makes is called with two dicts, the terms (scalars) and their lambdas, by
            name; of an `nn.Module`, buffers go into checkpoints and on with the training.
    """
    return BALANCERS.register(name, build)


def register_optimizer(
    name: str, build: Built | None = None, *, defaults: Mapping[str, Any] = NOTHING
) -> Any:
    """Register an optimiser: a class whose first parameter is `params`.

    Args:
        name: for `optimizer=NAME`.
        build: the class. `lr` and `weight_decay`, where it has them, are those that schedules and
            `optimizer.decoder_weight_decay` know.
        defaults: of options, where they differ from the signature's.
    """
    return OPTIMIZERS.register(name, build, defaults=dict(defaults))


def register_dataset(
    name: str,
    build: Built | None = None,
    *,
    split: str = "custom",
    normals: str = "derived",
    root: str = "???",
    defaults: Mapping[str, Any] = NOTHING,
    label: str | None = None,
    table: bool = False,
    rendered: bool = False,
    view: Callable[[tuple[int, int]], Any] | None = None,
) -> Any:
    """Register a data set: a `col3d.data.datasets.frame_set.FrameSet`, or a function that makes one.

    Args:
        name: for `data=NAME`, `data.test=NAME` and `data.also=NAME`.
        build: the class. It is given `root`, `videos` (entries of a split) and, if it takes it, `normals`;
            its other parameters are the options `data.<parameter>`. Where it has a static method `lens`, the
            name stands for that camera as well.
        split: the file of `conf/data/split` that it comes with; `custom` leaves the parts to the user.
        normals: `stored`, `derived` from depth, or `none`, unless told otherwise.
        root: where it lies; the user says it unless given here.
        defaults: of options, where they differ from the signature's.
        label: what people call it.
        table: its videos are those of `videos.csv`, which knows their frames and surfaces.
        rendered: its videos are made where they are not there, as `phantom` says.
        view: height and width -> where its lens shows anything.
    """
    facts: dict[str, Any] = {"split": split, "normals": normals, "root": root, "defaults": dict(defaults)}
    facts |= {"label": label or name, "table": table, "rendered": rendered, "view": view}
    return DATASETS.register(name, build, NOTHING, **facts)


def register_scheduler(name: str, build: Built | None = None, *, interval: str = "epoch") -> Any:
    """Register a schedule of the learning rate: a function or class (optimizer, options) -> `LRScheduler`.

    Args:
        name: for `scheduler=NAME`.
        build: the function or class. A parameter `training` is given the length of the training, a
            `TrainingLength`; `total_steps`, `total_iters` and `T_max` are that length unless given.
        interval: what it is stepped after unless `scheduler.interval` says otherwise, "step" or "epoch".
    """
    return SCHEDULERS.register(name, build, interval=interval)


def register_callback(name: str, build: Built | None = None) -> Any:
    """Register a callback of Lightning's Trainer.

    Args:
        name: for `callbacks.more.ENTRY=NAME`.
        build: the class. What it has to remember in a training that goes on, it gives in `state_dict`.
    """
    return CALLBACKS.register(name, build)


def register_logger(
    name: str, build: Built | None = None, *, needs: tuple[str, ...] = (), install: str = ""
) -> Any:
    """Register a logger of Lightning's Trainer: a function or class that makes one.

    Args:
        name: for `logger=NAME` and `logger=[NAME,NAME]`.
        build: the function or class. A parameter `folder` is given the run's folder; `run`, a word that is
            the same whenever the run goes on; `config`, the options of the training as plain values.
        needs: packages of which one has to be installed.
        install: what `pip install` is told where none is.
    """
    return LOGGERS.register(name, build, needs=needs, install=install)
