"""The one door for parts of an experiment: networks, losses, data sets, optimisers and more by name.

The signature is the schema: its parameters are the options, its defaults the only defaults.
"""

import functools
import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import Field
from pydantic_core import PydanticUndefined

from col3d import plugins
from col3d.checks import OptionError, nearest_name
from col3d.schema import Options, is_group, options_of, parameters, rule

Built = TypeVar("Built", bound=Callable[..., Any])
NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Part:
    """What a name stands for.

    Attributes:
        kind: a key of `KINDS`, such as "model".
        name: on the command line.
        build: a class or a function; its keyword parameters are the options.
        supplied: parameters that the program gives.
        rules: pydantic's `Field` for parameters that every part of this kind means alike, by name.
        chooses: other groups of options that this one brings along, such as `{"loss": "silog"}`.
        facts: what else the registration says.
    """

    kind: str
    name: str
    build: Callable[..., Any]
    supplied: tuple[str, ...] = ()
    rules: Mapping[str, Any] = field(default_factory=dict)
    chooses: Mapping[str, str] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def package(self) -> str:
        """Where it comes from: the first part of its module's name."""
        return self.build.__module__.partition(".")[0]

    @property
    def summary(self) -> str:
        """The first line of its docstring."""
        return next(iter((self.build.__doc__ or "").strip().splitlines()), "")

    def parameters(self) -> dict[str, tuple[Any, Any]]:
        """Its options: annotation and default, by name."""
        return parameters(self.build, self.supplied)

    @functools.cache  # noqa: B019 - parts live as long as the program
    def options(self, base: type[Options] = Options) -> type[Options]:
        """Its options as a pydantic model, on top of those of `base`."""
        return options_of(self.build, base, self.supplied, self.rules)


@dataclass
class Registry:
    """Parts of one kind.

    Args:
        kind: as on the command line, "model".
        homes: modules whose import registers the parts of this package; a later one is imported only for a
            name that the earlier ones do not have, or where all are listed.
        option: where a name of one is given, as messages say it.
        groups: of options whose choices are these parts, each with `module:function` from a part to what its
            choice brings there.
        supplied: parameters that the program gives to every part that has them.
        rules: pydantic's `Field` for parameters that every part means alike, by name.

    Attributes:
        parts: by name.
        refused: names of what other libraries have and does not serve here, with what to do instead.
    """

    kind: str
    homes: tuple[str, ...]
    option: str
    groups: Mapping[str, str] = field(default_factory=dict)
    supplied: tuple[str, ...] = ()
    rules: Mapping[str, Any] = field(default_factory=dict)
    parts: dict[str, Part] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def register(
        self,
        name: str,
        build: Built | None = None,
        chooses: Mapping[str, str] = NOTHING,
        **facts: Any,
    ) -> Any:
        """Give a name to a class or a function; without one, a decorator that does.

        Raises:
            ValueError: the name is no identifier, or another part has it.
            SignatureError: a parameter can neither be set by an option nor left out.
        """
        if build is None:
            return functools.partial(self._registered, name, chooses=chooses, facts=facts)
        return self._registered(name, build, chooses, facts)

    def _registered(
        self, name: str, build: Built, chooses: Mapping[str, str], facts: Mapping[str, Any]
    ) -> Built:
        if not name.isidentifier():
            raise ValueError(f"register_{self.kind}: a name is letters, digits and _, got {name!r}")
        part = Part(self.kind, name, build, self.supplied, self.rules, chooses, facts)
        before = self.parts.get(name)
        if before is not None and _place(before.build) != _place(build):
            raise ValueError(
                f"register_{self.kind}: {name!r} is {_place(before.build)} already; give "
                f"{_place(build)} another name"
            )
        part.parameters()
        self.parts[name] = part
        return build

    def find(self, name: str) -> Part | None:
        """The part of a name, or None."""
        plugins.load()
        for home in self.homes:
            if name not in self.parts:
                importlib.import_module(home)
        return self.parts.get(name)

    def __getitem__(self, name: str) -> Part:
        """The part of a name.

        Raises:
            OptionError: nothing has that name; the nearest that is there is named.
        """
        if part := self.find(name):
            return part
        if name in self.refused:
            raise OptionError(f"{self.option}: {name} is not offered: {self.refused[name]}")
        raise OptionError(
            f"{self.option}: {name!r} is unknown{nearest_name(str(name), self.parts)}; known: "
            f"{', '.join(self.names())}"
        )

    def names(self, everything: bool = True) -> list[str]:
        """All names, those of this package first; or those alone that are known without further imports."""
        plugins.load()
        for home in self.homes if everything else self.homes[:1]:
            importlib.import_module(home)
        return sorted(self.parts, key=lambda name: (self.parts[name].package != "col3d", name))

    def node(self, part: Part, group: str) -> dict[str, Any]:
        """What the choice of a part brings into a group of options: each with its default."""
        module, _, function = self.groups[group].partition(":")
        content: dict[str, Any] = getattr(importlib.import_module(module), function)(part)
        return content


def _place(build: Callable[..., Any]) -> str:
    return f"{build.__module__}.{build.__qualname__}"


MODELS = Registry(
    "model",
    ("col3d.models",),
    "model.name",
    groups={"model": "col3d.models.options:node"},
    supplied=("size_hw",),
)
LOSSES = Registry(
    "loss", ("col3d.losses.terms",), "loss.terms", supplied=("prediction", "batch", "max_depth")
)
OPTIMIZERS = Registry(
    "optimizer",
    ("col3d.optimizers", "col3d.timm_optimizers"),
    "optimizer.name",
    groups={"optimizer": "col3d.optimizers:node"},
    supplied=("params",),
    rules={
        "weight_decay": Field(ge=0),
        "eps": Field(gt=0),
        "momentum": Field(ge=0, lt=1),
    },
)
DATASETS = Registry(
    "dataset",
    ("col3d.data.datasets",),
    "data.name",
    groups={"data": "col3d.data.options:node", "data/source": "col3d.data.options:source_node"},
    supplied=("root", "videos", "normals", "camera", "truth", "rendered"),
)
COUNTS = ("total_steps", "total_iters", "T_max")
"""Parameters of schedules that are as long as the training unless they are given."""
SCHEDULERS = Registry(
    "scheduler",
    ("col3d.schedulers",),
    "scheduler.name",
    groups={"scheduler": "col3d.schedulers:node"},
    supplied=("optimizer", "training", "last_epoch", *COUNTS),
)
CALLBACKS = Registry("callback", ("col3d.callbacks.named",), "callbacks.more")
LOGGERS = Registry(
    "logger",
    ("col3d.loggers",),
    "logger",
    groups={"logger": "col3d.logger_options:node"},
    supplied=("folder", "run", "config"),
)
KINDS = {
    registry.kind: registry
    for registry in (MODELS, LOSSES, DATASETS, OPTIMIZERS, SCHEDULERS, CALLBACKS, LOGGERS)
}
GROUPS = {group: registry for registry in KINDS.values() for group in registry.groups}
"""Groups of options whose choices are registered parts."""


def register_model(
    name: str,
    build: Built | None = None,
    *,
    loss: str = "silog",
    task: str = "supervised",
    predicts: tuple[str, ...] = ("depth",),
    depth_alone: str | None = None,
    presets: Mapping[str, Mapping[str, Any]] = NOTHING,
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
    """
    facts = {"predicts": predicts, "depth_alone": depth_alone, "presets": presets}
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
    """Register a data set: a `col3d.data.frames.FrameSet`, or a function that makes one.

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


def available(kind: str) -> list[str]:
    """Names of the parts of a kind, such as "model"."""
    return _registry(kind).names()


def describe(kind: str, name: str) -> str:
    """A part's first sentence, where it comes from, and a line for each of its options."""
    part = _registry(kind)[name]
    lines = [f"{part.kind} {part.name} ({part.build.__module__}.{part.build.__qualname__})", part.summary, ""]
    above = KINDS[part.kind].option.rpartition(".")[0]
    return "\n".join([*lines, *_described(part.parameters(), above)])


def _described(options: Mapping[str, tuple[Any, Any]], above: str) -> Iterator[str]:
    for name, (annotation, default) in options.items():
        if is_group(annotation):
            inside = {
                key: (found.annotation, found.default) for key, found in annotation.model_fields.items()
            }
            yield from _described(inside, f"{above}.{name}")
        else:
            usual = "needed" if default is PydanticUndefined else f"{default!r} unless given"
            yield f"  {above}.{name}: {rule(annotation)}; {usual}"


def _registry(kind: str) -> Registry:
    if kind not in KINDS:
        raise OptionError(f"kind: {kind!r} is unknown{nearest_name(kind, KINDS)}; known: {', '.join(KINDS)}")
    return KINDS[kind]
