"""Options of `col3d download`."""

import re
from typing import Annotated, Literal

from pydantic import Field, model_validator

from col3d.data.options import Data, of_the_table
from col3d.registry import DATASETS
from col3d.registry.schema import Options


class DownloadOptions(Options):
    """Everything that `col3d download` takes."""

    data: Data
    videos: Literal["split", "all"] | Annotated[list[str], Field(min_length=1)]
    accept_licence: bool
    keep: bool
    parallel: Annotated[int, Field(ge=1, le=16)]
    attempts: Annotated[int, Field(ge=1, le=1000)]
    timeout: Annotated[float, Field(gt=0, le=3600)]
    server: str
    doi: str

    @model_validator(mode="after")
    def _is_published_there(self) -> "DownloadOptions":
        if not re.fullmatch(r"https?://[^/\s?#]+(/[^\s?#]*)?", self.server):
            raise ValueError(
                f"server: expected an address such as https://archive.data.jhu.edu, got {self.server!r}"
            )
        if not re.fullmatch(r"(doi|hdl):\S+", self.doi):
            raise ValueError(f"doi: expected one such as doi:10.7281/T1/JC64MK, got {self.doi!r}")
        if not DATASETS[self.data.name].facts["table"]:
            raise ValueError(
                f"data: {' and '.join(of_the_table())} can be downloaded, got data={self.data.name}"
            )
        if self.data.test or self.data.also:
            raise ValueError("data.test, data.also: are of trainings; col3d download fetches data=...")
        return self
