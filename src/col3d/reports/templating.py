"""Render the Jinja templates of pages."""

import base64
import mimetypes
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from col3d.reports import render
from col3d.reports.tables import marks


def filled(name: str, facts: Mapping[str, Any], **calls: Callable[..., Any]) -> str:
    """Render a template; HTML is escaped, Markdown is not.

    Args:
        name: such as "run.html".
        facts: variables of the template by name.
        calls: functions for this template, beside those that every template may call.
    """
    environment = Environment(
        loader=PackageLoader("col3d.reports"),
        autoescape=name.endswith(".html"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "heading": render.heading,
        "number": render.number,
        "interval": render.interval,
        "paper": render.paper,
        "markdown": render.markdown,
        "as_text": render.as_text,
        "as_code": render.as_code,
        "marks": marks,
        "data_uri": data_uri,
        **calls,
    }
    return environment.get_template(f"{name}.j2").render(facts)


def data_uri(path: Path) -> str:
    """A picture file as a base64 data URI."""
    kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
