"""Rich console that prints text without interpreting markup."""

from rich.console import Console


def plain_console(width: int | None = None) -> Console:
    """Rich's console without its markup: `z[b]x` and `:smile:` may be names of folders.

    Args:
        width: in columns; the screen's when absent.
    """
    return Console(width=width, markup=False, emoji=False, highlight=False)
