"""Make data ready for training."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from col3d.app.config import PrepareOptions
from col3d.app.errors import check_options
from col3d.checks import UserError


def prepare(given: Mapping[str, Any]) -> None:
    """Render what is missing of the phantom.

    Raises:
        UserError: an option breaks a rule, or the data set is not one that is rendered.
    """
    options = check_options(PrepareOptions, given)
    if options.data.name != "phantom":
        raise UserError(f"data={options.data.name} is read as it lies; prepare renders data=phantom")
    from col3d.app.build import phantom_settings
    from col3d.data.phantom import render_phantom

    settings = phantom_settings(options.phantom)
    render_phantom(Path(options.data.root), settings, workers=options.workers)
    print(
        f"phantom ready: {options.data.root}, {len(settings.videos)} videos "
        f"of {settings.frames_per_video} frames"
    )
