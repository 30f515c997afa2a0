"""Hydra plugins that offer registered parts as choices: `model=unet model.dropout=0.2` needs no file."""

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
"""Default choices of groups, which need no override."""


class RegisteredParts(ConfigSource):
    """Configuration source that offers every registered part as a file of its group.

    Files are made on request, so that listing the names imports little.
    """

    @staticmethod
    def scheme() -> str:
        """Return the scheme of this source's paths on Hydra's search path."""
        return "col3d"

    def load_config(self, config_path: str) -> ConfigResult:
        """Return the options of a part with their defaults, and its choices in other groups."""
        group, part = self._part_at(config_path)
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
        """Return True: registered parts are always available."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether a path is a group whose choices are parts, or the parent of such a group."""
        group = config_path.strip("/")
        return not group or any(f"{known}/".startswith(f"{group}/") for known in self.groups)

    def is_config(self, config_path: str) -> bool:
        """Whether a path names a part."""
        return self._part_at(config_path)[1] is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """List the groups inside a group, and the names of its parts."""
        group = config_path.strip("/")
        names: list[str] = []
        if results_filter is not ObjectType.CONFIG:
            inside = (known.removeprefix(group).strip("/") for known in self.groups if known != group)
            names += [
                name.partition("/")[0] for name in inside if not group or f"{group}/{name}" in self.groups
            ]
        if results_filter is not ObjectType.GROUP and group in self.groups:
            # help lists these; the complete list, as in `col3d list optimizers`, takes seconds
            names += GROUPS[group].names(everything=False)
        return sorted(set(names))

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups that the path names."""
        return tuple(self.path.split(","))

    def _part_at(self, config_path: str) -> tuple[str, Part | None]:
        group, _, name = config_path.strip("/").removesuffix(".yaml").rpartition("/")
        return group, GROUPS[group].find(name) if group in self.groups else None


class SearchPath(SearchPathPlugin):
    """Adds the folders `conf` of plugins, and registered parts, to Hydra's search path."""

    offered: ClassVar[list[str]] = [*DATASETS.groups]
    """Groups whose choices include registered parts."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append them after the files of this package: plugins' files first, then registered parts."""
        for folder in plugins.configurations():
            search_path.append("col3d.plugins", f"file://{folder}")
        if self.offered:
            search_path.append("col3d.registry", f"{RegisteredParts.scheme()}://{','.join(self.offered)}")


def offer_parts(groups: Iterable[str] = GROUPS) -> None:
    """Offer registered parts in these groups only, so that a program need not import the others."""
    SearchPath.offered = [*groups]


def load_plugins(arguments: Sequence[str]) -> list[str]:
    """Import plugins: those of `plugins=[...]` on a command line, of the environment, and installed ones.

    Returns:
        The arguments, with that option in a form that Hydra accepts if the configuration lacks it.

    Raises:
        OptionError: there is no such package.
    """
    named: list[str] = []
    for argument in arguments:
        if argument.lstrip("+").startswith(OPTION):
            try:
                value = OverridesParser.create().parse_override(argument).value()
            except HydraException:  # reported by Hydra's own run
                continue
            if not isinstance(value, str | list | int | float):
                raise OptionError(f"plugins: write [mylab,theirs], got {argument.partition('=')[2]}")
            named = [str(name) for name in value] if isinstance(value, list) else [str(value)]
    plugins.load(named)
    return [f"++{argument}" if argument.startswith(OPTION) else argument for argument in arguments]


Plugins.instance().register(RegisteredParts)
Plugins.instance().register(SearchPath)
