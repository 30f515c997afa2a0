"""`col3d completion`: shell completion, with lines for a shell's start-up file and the candidate words."""

import os
from contextlib import suppress

from col3d.cli.main import PROGRAMS

SHELLS = {
    "bash": "complete -o nospace -C 'col3d completion words' col3d",
    "zsh": "autoload -U +X bashcompinit; bashcompinit; complete -o nospace -C 'col3d completion words' col3d",
    "fish": "complete -c col3d -f -a '(COMP_LINE=(commandline -cp) col3d completion words)'",
}
HELP = """\
Add the line that `col3d completion SHELL` prints to the start-up file of your shell:

  echo "$(col3d completion bash)" >> ~/.bashrc
  echo "$(col3d completion zsh)" >> ~/.zshrc
  col3d completion fish > ~/.config/fish/completions/col3d.fish"""


def run(name: str, words: list[str]) -> int | None:
    """Print the start-up line for a shell, or completions of the line being typed (`COMP_LINE`)."""
    if words[:1] == ["words"]:
        for word in continuations(os.environ.get("COMP_LINE", "")):
            print(word)
        return None
    print(SHELLS.get(words[0], HELP) if words else HELP)
    return None


def continuations(line: str) -> list[str]:
    """List completions of the last word of a command line.

    >>> continuations("col3d ev")
    ['evaluate ']
    """
    words = line.split(" ")
    last = words[-1]
    if len(words) < 3:
        return [f"{program} " for program in PROGRAMS if program.startswith(last)]
    return _options(words[1], words[2:-1], last)


def _options(program: str, before: list[str], last: str) -> list[str]:
    """List a program's options, or the choices of a group if the last word contains `=`.

    A shell ends a word at `=`, so that choices are returned without the option.
    """
    from hydra.errors import HydraException

    from col3d.cli.files import CONF, names_in
    from col3d.cli.parts import load_plugins, offer_parts
    from col3d.cli.refusals import option_names
    from col3d.errors import OptionError, UserError

    if not (CONF / f"{program}.yaml").is_file():
        return []
    with suppress(OptionError):  # a plugin that is not installed offers nothing
        load_plugins(before)
    offer_parts()
    group, equals, value = last.partition("=")
    if equals:
        return [f"{name} " for name in names_in(group) if name.startswith(value)]
    with suppress(HydraException, UserError):  # the words before are incomplete
        return [f"{name}=" for name in option_names(program, before) if name.startswith(last)]
    return []
