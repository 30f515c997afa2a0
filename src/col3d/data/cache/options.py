"""Options of `col3d prepare`."""

from typing import Annotated

from pydantic import Field

from col3d.data.options import Data
from col3d.phantom.options import PhantomOptions
from col3d.registry.schema import Options


class PrepareFileOptions(Options):
    """What `col3d prepare` takes beside data and phantom."""

    preset: str | None
    out: str | None


class PrepareOptions(Options):
    """Everything that `col3d prepare` takes."""

    data: Data
    phantom: PhantomOptions
    prepare: PrepareFileOptions
    workers: Annotated[int, Field(ge=1)] | None
