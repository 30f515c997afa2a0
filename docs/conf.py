"""How Sphinx builds these pages: Markdown by MyST, docstrings by autodoc, and nothing from the network."""

import pkgutil
import re
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[1]
METADATA = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = METADATA["name"]
author = METADATA["authors"][0]["name"]
release = METADATA["version"]
copyright = f"2026, {author}"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
default_role = "code"  # docstrings name things in single backticks, as Markdown does
myst_heading_anchors = 3
suppress_warnings = ["config.cache"]

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "show-inheritance": True, "ignore-module-all": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_attr_annotations = False
add_module_names = False
python_maximum_signature_line_length = 110
toc_object_entries = False

html_theme = "furo"
pygments_style = "default"
pygments_dark_style = "monokai"
html_title = "col3d"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sourcelink = False

linkcheck_timeout = 20
linkcheck_retries = 2

LONGEST_VALUE = 60
"""Characters of a constant's value."""
HIDDEN_COLON = "\ue000"
MODULES = re.compile(r"^<!-- modules of ([\w.]+) -->$", re.MULTILINE)
"""Stands in a page where the documentation of a package and all its modules belongs."""
BESIDE = re.compile(r"\]\(((?:\.\./)+)(CONTRIBUTING|CHANGELOG|THIRD_PARTY_NOTICES)\.md")
"""A link to a page at the root of the repository, which a page here includes."""


def modules_of(package: str) -> list[str]:
    """The package, or module, and all modules below it, but for those that only run."""
    path = getattr(import_module(package), "__path__", [])
    found = pkgutil.walk_packages(path, f"{package}.")
    return [package, *(module.name for module in found if not module.name.endswith("__main__"))]


def expand_modules(match: re.Match[str]) -> str:
    """The docstrings of the package, and below a heading of its own those of each module."""
    block = "```{{eval-rst}}\n.. automodule:: {0}\n```\n"
    package, *modules = modules_of(match[1])
    return "\n".join([block.format(package), *(f"## {name}\n\n{block.format(name)}" for name in modules)])


def prepare_page(app: Sphinx, page: str, source: list[str]) -> None:
    """Modules where a page asks for them, and links between pages as they are here."""
    text = MODULES.sub(expand_modules, source[0])
    depth = "../" * page.count("/")
    source[0] = BESIDE.sub(lambda match: f"]({depth}{match[2].lower()}.md", text)


def hide_colons(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from reading `Millimetres: ...` below a constant as its type."""
    if what in ("attribute", "data", "property") and lines:
        lines[0] = lines[0].replace(":", HIDDEN_COLON)


def plain_signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str, str | None] | None:
    """Signatures with values that have no literal, such as factories, as Python that Sphinx can read."""
    if signature is None or "<" not in signature:
        return None
    return re.sub(r"~(?:\w+\.)*", "", re.sub(r"<(?:[^<>]|<[^<>]*>)*>", "...", signature)), returns


def finish_docstring(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Colons as they were; bars as they are: absolute values, where reStructuredText has substitutions."""
    for i, line in enumerate(lines):
        shown = line if ">>>" in line else re.sub(r"(?<!`)\|(?!`)", r"\|", line)
        lines[i] = shown.replace(HIDDEN_COLON, ":")


def hide_long_values(app: Sphinx, page: nodes.document) -> None:
    """Constants whose value does not fit on a line are shown by their name."""
    for note in list(page.findall(addnodes.desc_annotation)):
        if note.astext().startswith(" = ") and len(note.astext()) > LONGEST_VALUE:
            note.parent.remove(note)


def setup(app: Sphinx) -> None:
    """Connect what is above."""
    for name in modules_of("col3d"):  # now: autodoc changes pydantic's base, and models made later would fail
        import_module(name)
    app.connect("source-read", prepare_page)
    app.connect("autodoc-process-signature", plain_signature)
    app.connect("autodoc-process-docstring", hide_colons, priority=400)  # napoleon has 500
    app.connect("autodoc-process-docstring", finish_docstring)
    app.connect("doctree-read", hide_long_values)
