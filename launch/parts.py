"""Registered parts as choices of the configuration: `model=unet model.dropout=0.2` needs no file."""

from collections.abc import Sequence

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.search_path_plugin import SearchPathPlugin

from col3d import plugins
from launch.files import CONF

OPTION = "plugins="
USUAL = {"task": "supervised"}
"""Choices that a configuration has without being told."""


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
    from col3d.models.options import node
    from col3d.registry import MODELS

    store = ConfigStore.instance()
    for name in MODELS.names():
        part = MODELS[name]
        if not (CONF / part.kind / f"{name}.yaml").is_file():
            chosen = {group: choice for group, choice in part.chooses.items() if USUAL.get(group) != choice}
            content = {
                "defaults": [{f"override /{group}": choice} for group, choice in chosen.items()],
                part.kind: node(part),
            }
            store.store(f"{name}.yaml", content, part.kind, "_global_", provider=part.package)


Plugins.instance().register(PluginConfigurations)
