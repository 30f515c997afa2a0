"""Registered parts as choices of the configuration: `model=unet model.dropout=0.2` needs no file."""

from collections.abc import Iterable, Sequence
from typing import ClassVar

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from col3d.errors import OptionError
from col3d.registry import DATASETS, GROUPS, Part, plugins
from col3d.registry.annotations import is_group

OPTION = "plugins="
USUAL = {"task": "supervised"}
"""Choices that a configuration has without being told."""


class RegisteredParts(ConfigSource):
    """Every registered part as a file of its group, made when it is asked for: names alone import little."""

    @staticmethod
    def scheme() -> str:
        """Of paths on Hydra's search path."""
        return "col3d"

    def load_config(self, config_path: str) -> ConfigResult:
        """The options of a part with their defaults, and the groups that it brings along."""
        group, part = self._found(config_path)
        assert part is not None
        content = own = GROUPS[group].node(part, group)
        chosen = {other: choice for other, choice in part.chooses.items() if USUAL.get(other) != choice}
        package = None
        if chosen:
            defaults = [{f"override /{other}": choice} for other, choice in chosen.items()]
            package, content = "_global_", {"defaults": defaults, group: content}
        config = OmegaConf.create(content)
        for name, (annotation, _) in part.parameters().items():
            if isinstance(own.get(name), dict) and not is_group(annotation):  # a mapping takes any key
                OmegaConf.set_struct(config[group][name] if chosen else config[name], False)
        return ConfigResult(part.package, self.full_path(), config, {"package": package})

    def available(self) -> bool:
        """Always."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether its choices are parts, or it is above such a group."""
        group = config_path.strip("/")
        return not group or any(f"{known}/".startswith(f"{group}/") for known in self.groups)

    def is_config(self, config_path: str) -> bool:
        """Whether it is a part."""
        return self._found(config_path)[1] is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Groups inside one, and names of parts."""
        group = config_path.strip("/")
        found: list[str] = []
        if results_filter is not ObjectType.CONFIG:
            inside = (known.removeprefix(group).strip("/") for known in self.groups if known != group)
            found += [
                name.partition("/")[0] for name in inside if not group or f"{group}/{name}" in self.groups
            ]
        if results_filter is not ObjectType.GROUP and group in self.groups:
            # what help lists: `col3d list optimizers` takes seconds to know them all
            found += GROUPS[group].names(everything=False)
        return sorted(set(found))

    @property
    def groups(self) -> tuple[str, ...]:
        """Those that the path names."""
        return tuple(self.path.split(","))

    def _found(self, config_path: str) -> tuple[str, Part | None]:
        group, _, name = config_path.strip("/").removesuffix(".yaml").rpartition("/")
        return group, GROUPS[group].find(name) if group in self.groups else None


class SearchPath(SearchPathPlugin):
    """Lets a folder `conf` inside a plugin, and registered parts, join the groups of options."""

    offered: ClassVar[list[str]] = [*DATASETS.groups]
    """Groups of options that parts join."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append them: files of this package go first, those of plugins before what signatures say."""
        for folder in plugins.configurations():
            search_path.append("col3d.plugins", f"file://{folder}")
        if self.offered:
            search_path.append("col3d.registry", f"{RegisteredParts.scheme()}://{','.join(self.offered)}")


def offer_parts(groups: Iterable[str] = GROUPS) -> None:
    """Make parts choices of these groups: a program knows no others, and need not import what they are."""
    SearchPath.offered = [*groups]


def load_plugins(arguments: Sequence[str]) -> list[str]:
    """Import what `plugins=[...]` on a command line names, and what the environment and packages do.

    Returns:
        The arguments, with that option in a form that programs take whose configuration does not have it.

    Raises:
        OptionError: there is no such package.
    """
    named: list[str] = []
    for argument in arguments:
        if argument.lstrip("+").startswith(OPTION):
            try:
                value = OverridesParser.create().parse_override(argument).value()
            except HydraException:  # said by Hydra's own run
                continue
            if not isinstance(value, str | list | int | float):
                raise OptionError(f"plugins: write [mylab,theirs], got {argument.partition('=')[2]}")
            named = [str(name) for name in value] if isinstance(value, list) else [str(value)]
    plugins.load(named)
    return [f"++{argument}" if argument.startswith(OPTION) else argument for argument in arguments]


Plugins.instance().register(RegisteredParts)
Plugins.instance().register(SearchPath)
