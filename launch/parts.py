"""Registered parts as choices of the configuration: `model=unet model.dropout=0.2` needs no file."""

from collections.abc import Sequence
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.search_path_plugin import SearchPathPlugin

from col3d import plugins
from col3d.registry import Part

OPTION = "plugins="
USUAL = {"task": "supervised"}
"""Choices that a configuration has without being told."""

_stored: dict[tuple[str, str], Part] = {}
"""What is in the store, which takes a while to fill."""


class PluginConfigurations(SearchPathPlugin):
    """Lets a folder `conf` inside a plugin join the groups of options."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append the folders of the loaded plugins: what this project has goes first."""
        for folder in plugins.configurations():
            search_path.append("col3d.plugins", f"file://{folder}")


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


def store_parts() -> None:
    """Put every registered part into Hydra's store of configurations; files of the same name go first."""
    from col3d import logger_options, optimizers, schedulers
    from col3d.models import options as models
    from col3d.registry import LOGGERS, MODELS, OPTIMIZERS, SCHEDULERS

    nodes = (
        (MODELS, models.node),
        (OPTIMIZERS, optimizers.node),
        (SCHEDULERS, schedulers.node),
        (LOGGERS, logger_options.node),
    )
    ConfigStore.instance().store("csv.yaml", {"logger": {}}, "logger", "_global_", provider="col3d")
    for registry, node in nodes:
        for part in map(registry.__getitem__, registry.names()):
            if _stored.get((part.kind, part.name)) is not part:
                _store(part, node(part))
                _stored[part.kind, part.name] = part


def _store(part: Part, content: dict[str, Any]) -> None:
    chosen = {group: choice for group, choice in part.chooses.items() if USUAL.get(group) != choice}
    defaults = [{f"override /{group}": choice} for group, choice in chosen.items()]
    whole = {"defaults": defaults, part.kind: content}
    ConfigStore.instance().store(f"{part.name}.yaml", whole, part.kind, "_global_", provider=part.package)


Plugins.instance().register(PluginConfigurations)
