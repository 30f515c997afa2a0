"""Registered parts as choices of the configuration: `model=unet model.dropout=0.2` needs no file."""

from collections.abc import Sequence
from typing import Any, ClassVar

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from col3d import plugins
from col3d.cli.files import is_kind
from col3d.registry import KINDS, Part

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
        part = self._part(config_path)
        assert part is not None
        content = OmegaConf.create(_content(part))
        return ConfigResult(part.package, self.full_path(), content, {"package": "_global_"})

    def available(self) -> bool:
        """Always."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether it is a kind of parts."""
        group = config_path.strip("/")
        return not group or group in self.kinds

    def is_config(self, config_path: str) -> bool:
        """Whether it is a part."""
        return self._part(config_path) is not None

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Kinds at the root, names of parts in one."""
        group = config_path.strip("/")
        if not group:
            found, wanted = sorted(self.kinds), ObjectType.GROUP
        else:
            # what help lists: `col3d list optimizers` takes seconds to know them all
            found, wanted = sorted(KINDS[group].names(everything=False)), ObjectType.CONFIG
        return found if results_filter in (None, wanted) else []

    @property
    def kinds(self) -> tuple[str, ...]:
        """Those that the path names."""
        return tuple(self.path.split(","))

    def _part(self, config_path: str) -> Part | None:
        kind, _, name = config_path.strip("/").removesuffix(".yaml").partition("/")
        return KINDS[kind].find(name) if kind in self.kinds else None


class SearchPath(SearchPathPlugin):
    """Lets a folder `conf` inside a plugin, and registered parts, join the groups of options."""

    offered: ClassVar[list[str]] = []
    """Kinds of parts."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append them: files of this package go first, those of plugins before what signatures say."""
        for folder in plugins.configurations():
            search_path.append("col3d.plugins", f"file://{folder}")
        if self.offered:
            search_path.append("col3d.registry", f"{RegisteredParts.scheme()}://{','.join(self.offered)}")


def offer_parts() -> None:
    """Make every kind of registered parts a group of options."""
    SearchPath.offered = [kind for kind in KINDS if is_kind(kind)]


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
            named = [str(name) for name in value] if isinstance(value, list) else [str(value)]
    plugins.load(named)
    return [f"++{argument}" if argument.startswith(OPTION) else argument for argument in arguments]


def _content(part: Part) -> dict[str, Any]:
    chosen = {group: choice for group, choice in part.chooses.items() if USUAL.get(group) != choice}
    defaults = [{f"override /{group}": choice} for group, choice in chosen.items()]
    return {"defaults": defaults, part.kind: KINDS[part.kind].defaults(part)}


Plugins.instance().register(RegisteredParts)
Plugins.instance().register(SearchPath)
