"""Options of `col3d verify`."""

from typing import Annotated

from pydantic import Field, model_validator

from col3d.data.options import Data
from col3d.phantom.options import PhantomOptions
from col3d.registry.schema import Options


class VerifyOptions(Options):
    """Everything that `col3d verify` takes."""

    data: Data
    phantom: PhantomOptions
    fast: bool
    output: str
    workers: Annotated[int, Field(ge=1)] | None

    @model_validator(mode="after")
    def _fits(self) -> "VerifyOptions":
        if self.data.test or self.data.also:
            raise ValueError("data.test, data.also: are of trainings; col3d verify checks data=...")
        return self
