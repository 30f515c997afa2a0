"""A registered part, and the registry of one kind of parts."""

import functools
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from col3d.errors import OptionError
from col3d.nearest_names import nearest_name
from col3d.registry import plugins
from col3d.registry.schema import Options, SignatureError, home_of, options_of, parameters, place_of

Built = TypeVar("Built", bound=Callable[..., Any])
NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Part:
    """A registered class or function, with its name and options.

    Attributes:
        kind: a key of `KINDS`, such as "model".
        name: name on the command line.
        build: a class or a function; its keyword parameters are the options.
        supplied: names of parameters that the program supplies.
        rules: pydantic's `Field` by parameter name, for parameters with one meaning in the whole kind.
        chooses: choices in other groups of options that this part implies, such as `{"loss": "silog"}`.
        facts: further keyword arguments of the registration.
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
        """Top-level package that it comes from."""
        home: str = home_of(self.build).__module__
        return home.partition(".")[0]

    @property
    def summary(self) -> str:
        """The first line of its docstring."""
        return next(iter((home_of(self.build).__doc__ or "").strip().splitlines()), "")

    def made(self, value: Any, attribute: str) -> Any:
        """Return what `build` made, after checking that it is of this kind.

        Args:
            value: what `build` made.
            attribute: name of an attribute that every part of this kind has.

        Raises:
            OptionError: it lacks the attribute.
        """
        if hasattr(value, attribute):
            return value
        raise OptionError(
            f"{self.kind} {self.name}: {place_of(self.build)} gives {type(value).__name__}, which is no "
            f"{self.kind}"
        )

    def parameters(self) -> dict[str, tuple[Any, Any]]:
        """Return the annotation and default of each of its options, by name."""
        return parameters(self.build, self.supplied)

    def own(self, options: Options) -> dict[str, Any]:
        """Select its own options from checked options, without those of every part of its kind."""
        return {name: getattr(options, name) for name in self.parameters()}

    @functools.cache  # noqa: B019 - parts live as long as the program
    def options(self, base: type[Options] = Options) -> type[Options]:
        """Return its options as a pydantic model that extends `base`."""
        return options_of(self.build, base, self.supplied, self.rules)


@dataclass
class Registry:
    """The registered parts of one kind, by name.

    Args:
        kind: name of the kind, such as "model".
        homes: modules whose import registers the parts of this package; a later one is imported only for a
            name that the earlier ones lack, or to list all names.
        option: the option that names a part, for messages.
        place: the group with a part's options; {name} stands for the part's name.
        groups: groups of options whose choices are these parts, each with the `module:function` that maps a
            part to the content of that group.
        supplied: names of parameters that the program supplies to every part that has them.
        rules: pydantic's `Field` by parameter name, for parameters with one meaning in all parts.
        taken: names of the program's own options in that group, which no parameter may have.

    Attributes:
        parts: the registered parts by name.
        refused: names in other libraries that are not offered here, with what to do instead.
    """

    kind: str
    homes: tuple[str, ...]
    option: str
    place: str
    groups: Mapping[str, str] = field(default_factory=dict)
    supplied: tuple[str, ...] = ()
    rules: Mapping[str, Any] = field(default_factory=dict)
    taken: tuple[str, ...] = ()
    parts: dict[str, Part] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def register(
        self,
        name: str,
        build: Built | None = None,
        chooses: Mapping[str, str] = NOTHING,
        **facts: Any,
    ) -> Any:
        """Register a class or a function under a name; without `build`, return a decorator that does.

        Raises:
            ValueError: the name is no identifier, or another part has it.
            SignatureError: a parameter can neither be set by an option nor left out, or has the name of an
                option of the program.
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
        if before is not None and place_of(before.build) != place_of(build):
            # a plugin may be loaded before the part of this package that has the name
            renamed, kept = (before, part) if part.package == "col3d" else (part, before)
            raise ValueError(
                f"register_{self.kind}: {name!r} is {place_of(kept.build)} already; give "
                f"{place_of(renamed.build)} another name"
            )
        if both := [option for option in part.parameters() if option in self.taken]:
            option = f"{self.place.format(name=name)}.{both[0]}"
            raise SignatureError(
                f"{place_of(build)}: parameter {both[0]!r} needs another name: {option} is an option of "
                f"every {self.kind}"
            )
        self.parts[name] = part
        return build

    def find(self, name: str) -> Part | None:
        """Return the part with a name, or None."""
        plugins.load()
        for home in self.homes:
            if name not in self.parts:
                importlib.import_module(home)
        return self.parts.get(name)

    def __getitem__(self, name: str) -> Part:
        """Return the part with a name.

        Raises:
            OptionError: no part has that name; the message gives the nearest one.
        """
        if part := self.find(name):
            return part
        if name in self.refused:
            raise OptionError(f"{self.option}: {name} is not offered: {self.refused[name]}")
        raise OptionError(
            f"{self.option}: {name!r} is unknown{nearest_name(str(name), self.parts)}; known: "
            f"{', '.join(self.names())}"
        )

    def load(self, everything: bool = True) -> None:
        """Import all modules in `homes`, or only the first one, and the plugins."""
        plugins.load()
        for home in self.homes if everything else self.homes[:1]:
            importlib.import_module(home)

    def names(self, everything: bool = True) -> list[str]:
        """List all names, those of this package first; or only those that take no further imports."""
        self.load(everything)
        return sorted(self.parts, key=lambda name: (self.parts[name].package != "col3d", name))

    def node(self, part: Part, group: str) -> dict[str, Any]:
        """Return the content of a group of options when a part is chosen: every option with its default."""
        module, _, function = self.groups[group].partition(":")
        content: dict[str, Any] = getattr(importlib.import_module(module), function)(part)
        return content
