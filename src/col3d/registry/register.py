"""Functions that register parts, one for each kind; each is a decorator or a plain call."""

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
        build: the class, or a function that makes the network. A parameter `size_hw` receives the height and
            width of the frames.
        loss: the file of `conf/loss` that it trains with by default.
        task: the file of `conf/task` that it trains with by default.
        predicts: what the network itself predicts, of "depth" and "normals".
        depth_alone: name of the same network without normals, for hints.
        presets: defaults of options at a `preset`, where they differ from the signature's.
        label: its name in reports; if empty, `name`.
        colour: colour of its lines in figures, as "#RRGGBB"; if empty, reports choose one.

    Raises:
        ValueError: as `Registry.register`; or the label is not one line, or the colour not #RRGGBB.
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
        build: the function. It must be zero at the ground truth, and have no gradient at pixels outside of
            `batch["mask"]`. A parameter `max_depth` receives the network's maximum depth in mm.
        needs: what the network has to predict for it, of "depth" and "normals".
        truth: ground truth that it needs beside depth: "normals".
    """
    return LOSSES.register(name, build, needs=needs, truth=truth)


def register_metric(
    name: str,
    build: Built | None = None,
    *,
    task: str = "depth",
    better: str | None = None,
    **spec_fields: Any,
) -> Any:
    """Register a metric: a function (preds, target, mask, and its options) -> one value a frame, (b,).

    Depth is (b, 1, h, w) in mm, normals are unit (b, 3, h, w), the mask is (b, 1, h, w), True where a pixel
    counts. Predictions are clipped to between 0.001 mm and the upper end of the protocol's range, unless the
    function has parameters `min_depth` and `max_depth`, which it then receives. NaN means that a frame has no
    value: its cell stays empty, and it is left out of means.

    Args:
        name: name of its column, and for `metrics.NAME.OPTION=VALUE`.
        build: the function.
        task: what it is measured on, "depth" or "normals".
        better: "lower", "higher", or None if neither is better.
        spec_fields: further fields of `MetricSpec`, such as unit and heading.

    Raises:
        ValueError: a value is unknown, or the name is that of another column.
    """
    spec = checked_spec(MetricSpec(name, task, better, **spec_fields))
    return METRICS.register(name, build, spec=spec)


def register_metrics(specs: Iterable[MetricSpec], build: Built) -> Built:
    """Register metrics that one function computes together: it returns a dict of (b,) by name."""
    for spec in specs:
        METRICS.register(spec.name, build, spec=checked_spec(spec))
    return build


def register_balancer(name: str, build: Built | None = None) -> Any:
    """Register a balancer: a class whose instances combine the terms of a batch into the loss.

    Args:
        name: for `loss/balance=NAME`.
        build: the class. An instance is called with two dicts by name, the terms (scalars) and their lambdas,
            and returns what is minimised. The buffers of an `nn.Module` are saved in checkpoints and restored
            when the training goes on.
    """
    return BALANCERS.register(name, build)


def register_optimizer(
    name: str, build: Built | None = None, *, defaults: Mapping[str, Any] = NOTHING
) -> Any:
    """Register an optimiser: a class whose first parameter is `params`.

    Args:
        name: for `optimizer=NAME`.
        build: the class. Its parameters `lr` and `weight_decay`, if any, are those that schedules and
            `optimizer.decoder_weight_decay` change.
        defaults: defaults of options, where they differ from the signature's.
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
        build: the class. It receives `root`, `videos` (entries of a split) and, if it has the parameter,
            `normals`; its other parameters are the options `data.<parameter>`. If it has a static method
            `lens`, the name also stands for that camera.
        split: its default file of `conf/data/split`; `custom` leaves the parts to the user.
        normals: default source of normals: `stored`, `derived` from depth, or `none`.
        root: default of its folder; unless given, the user has to set it.
        defaults: defaults of options, where they differ from the signature's.
        label: its usual name, for reports.
        table: whether its videos are listed in `videos.csv`, with their frames and surfaces.
        rendered: whether missing videos are rendered by `phantom`.
        view: function from height and width to the mask of pixels that its lens shows.
    """
    facts: dict[str, Any] = {"split": split, "normals": normals, "root": root, "defaults": dict(defaults)}
    facts |= {"label": label or name, "table": table, "rendered": rendered, "view": view}
    return DATASETS.register(name, build, NOTHING, **facts)


def register_scheduler(name: str, build: Built | None = None, *, interval: str = "epoch") -> Any:
    """Register a schedule of the learning rate: a function or class (optimizer, options) -> `LRScheduler`.

    Args:
        name: for `scheduler=NAME`.
        build: the function or class. A parameter `training` receives the length of the training, a
            `TrainingLength`; `total_steps`, `total_iters` and `T_max` default to that length.
        interval: how often it is stepped by default, after each "step" or "epoch".
    """
    return SCHEDULERS.register(name, build, interval=interval)


def register_callback(name: str, build: Built | None = None) -> Any:
    """Register a callback of Lightning's Trainer.

    Args:
        name: for `callbacks.more.ENTRY=NAME`.
        build: the class. State that a training has to restore when it goes on belongs in `state_dict`.
    """
    return CALLBACKS.register(name, build)


def register_logger(
    name: str, build: Built | None = None, *, needs: tuple[str, ...] = (), install: str = ""
) -> Any:
    """Register a logger of Lightning's Trainer: a function or class that makes one.

    Args:
        name: for `logger=NAME` and `logger=[NAME,NAME]`.
        build: the function or class. A parameter `folder` receives the run's folder; `run`, an identifier
            that stays the same when the run goes on; `config`, the options of the training as plain values.
        needs: packages, one of which has to be installed.
        install: argument of `pip install` for the message if none is installed.
    """
    return LOGGERS.register(name, build, needs=needs, install=install)
