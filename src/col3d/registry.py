"""The one door for parts of an experiment: networks, losses, metrics and optimisers by name.

The signature is the schema: its parameters are the options, its defaults the only defaults.
"""

import functools
import importlib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import Field
from pydantic_core import PydanticUndefined

from col3d import plugins
from col3d.checks import OptionError, nearest_name
from col3d.metric_specs import MetricSpec, checked_spec
from col3d.schema import Options, options_of, parameters, rule

Built = TypeVar("Built", bound=Callable[..., Any])
NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Part:
    """What a name stands for.

    Attributes:
        kind: "model", "loss", "metric" or "optimizer".
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
        home: the module whose import registers the parts of this package.
        option: where a name of one is given, as messages say it.
        supplied: parameters that the program gives to every part that has them.
        rules: pydantic's `Field` for parameters that every part means alike, by name.
    """

    kind: str
    home: str
    option: str
    supplied: tuple[str, ...] = ()
    rules: Mapping[str, Any] = field(default_factory=dict)
    parts: dict[str, Part] = field(default_factory=dict)

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

    def __getitem__(self, name: str) -> Part:
        """The part of a name.

        Raises:
            OptionError: nothing has that name; the nearest that is there is named.
        """
        self.load()
        if name not in self.parts:
            raise OptionError(
                f"{self.option}: {name!r} is unknown{nearest_name(str(name), self.parts)}; known: "
                f"{', '.join(self.names())}"
            )
        return self.parts[name]

    def names(self) -> list[str]:
        """All names: those of this package first."""
        self.load()
        return sorted(self.parts, key=lambda name: (self.parts[name].package != "col3d", name))

    def load(self) -> None:
        """Import the parts of this package and of the plugins that are named."""
        importlib.import_module(self.home)
        plugins.load()


def _place(build: Callable[..., Any]) -> str:
    return f"{build.__module__}.{build.__qualname__}"


MODELS = Registry("model", "col3d.models", option="model.name", supplied=("size_hw",))
LOSSES = Registry("loss", "col3d.losses.terms", "loss.terms", ("prediction", "batch", "max_depth"))
METRICS = Registry(
    "metric",
    "col3d.metrics.registered",
    "metrics",
    supplied=("preds", "target", "mask", "min_depth", "max_depth", "cosine_epsilon"),
)
OPTIMIZERS = Registry(
    "optimizer",
    "col3d.optimizers",
    "optimizer.name",
    supplied=("params",),
    rules={
        "weight_decay": Field(ge=0),
        "eps": Field(gt=0),
        "momentum": Field(ge=0, lt=1),
    },
)
KINDS = {registry.kind: registry for registry in (MODELS, LOSSES, METRICS, OPTIMIZERS)}


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


def available(kind: str) -> list[str]:
    """Names of the parts of a kind, such as "model"."""
    return _registry(kind).names()


def describe(kind: str, name: str) -> str:
    """A part's first sentence, where it comes from, and a line for each of its options."""
    part = _registry(kind)[name]
    place = f"metrics.{name}" if part.kind == METRICS.kind else part.kind
    lines = [f"{part.kind} {part.name} ({part.build.__module__}.{part.build.__qualname__})", part.summary, ""]
    for option, (annotation, default) in part.parameters().items():
        usual = "needed" if default is PydanticUndefined else f"{default!r} unless given"
        lines.append(f"  {place}.{option}: {rule(annotation)}; {usual}")
    return "\n".join(lines)


def _registry(kind: str) -> Registry:
    if kind not in KINDS:
        raise OptionError(f"kind: {kind!r} is unknown{nearest_name(kind, KINDS)}; known: {', '.join(KINDS)}")
    return KINDS[kind]
