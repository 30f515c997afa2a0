"""The pages of the documentation, and the blocks of code in them."""

import re
from pathlib import Path

PROJECT = Path(__file__).parents[2]
PAGES = [PROJECT / "README.md", *sorted((PROJECT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    """The contents of the fenced blocks of a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


def file_of(block: str) -> str | None:
    """The file that a block says it is, in its first line."""
    match = re.match(r"# ((?:src|conf|mylab)/\S+)\n", block)
    return match and match[1]
