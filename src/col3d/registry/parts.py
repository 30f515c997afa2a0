"""Parts by name, and the registry of one kind of them."""

import functools
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from col3d import plugins
from col3d.checks import OptionError, nearest_name
from col3d.schema import Options, options_of, parameters

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
        place: where the options of one are given, {name} for its name.
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
    place: str
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
