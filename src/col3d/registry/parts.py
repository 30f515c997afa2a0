"""Parts by name, and the registry of one kind of them."""

import functools
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from col3d.errors import OptionError, nearest_name
from col3d.registry import plugins
from col3d.registry.schema import Options, SignatureError, home_of, options_of, parameters, place_of

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
        home: str = home_of(self.build).__module__
        return home.partition(".")[0]

    @property
    def summary(self) -> str:
        """The first line of its docstring."""
        return next(iter((home_of(self.build).__doc__ or "").strip().splitlines()), "")

    def made(self, value: Any, attribute: str) -> Any:
        """What `build` gave, if it is of this kind.

        Raises:
            OptionError: it lacks an attribute that every part of this kind has.
        """
        if hasattr(value, attribute):
            return value
        raise OptionError(
            f"{self.kind} {self.name}: {place_of(self.build)} gives {type(value).__name__}, which is no "
            f"{self.kind}"
        )

    def parameters(self) -> dict[str, tuple[Any, Any]]:
        """Its options: annotation and default, by name."""
        return parameters(self.build, self.supplied)

    def own(self, options: Options) -> dict[str, Any]:
        """Those among checked options that are its own, and not of every part of its kind."""
        return {name: getattr(options, name) for name in self.parameters()}

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
        taken: names of options that the program has beside a part's own, which no parameter may have.

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
        """Give a name to a class or a function; without one, a decorator that does.

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
            # whose file is whose is known by now: a plugin may be loaded before our own part of that name
            theirs, ours = (before, part) if part.package == "col3d" else (part, before)
            raise ValueError(
                f"register_{self.kind}: {name!r} is {place_of(ours.build)} already; give "
                f"{place_of(theirs.build)} another name"
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

    def load(self, everything: bool = True) -> None:
        """Import the parts of this package, or those alone of its first module, and those of plugins."""
        plugins.load()
        for home in self.homes if everything else self.homes[:1]:
            importlib.import_module(home)

    def names(self, everything: bool = True) -> list[str]:
        """All names, those of this package first; or those alone that are known without further imports."""
        self.load(everything)
        return sorted(self.parts, key=lambda name: (self.parts[name].package != "col3d", name))

    def node(self, part: Part, group: str) -> dict[str, Any]:
        """What the choice of a part brings into a group of options: each with its default."""
        module, _, function = self.groups[group].partition(":")
        content: dict[str, Any] = getattr(importlib.import_module(module), function)(part)
        return content
