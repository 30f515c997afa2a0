"""Options of the rendered colon."""

from typing import Annotated

from pydantic import Field

from col3d.data.options import Size
from col3d.registry.schema import Options


class PhantomOptions(Options):
    """What is rendered where data=phantom is not there yet."""

    size: Size
    frames_per_video: Annotated[int, Field(ge=2)]
    seed: Annotated[int, Field(ge=0)]
