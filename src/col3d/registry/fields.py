"""Types of options that several packages share."""

from typing import Annotated, Literal

from pydantic import Field

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Accelerator = Literal["auto", "cpu", "gpu", "cuda"]
"""Device to compute on; `auto` is a GPU if there is one."""
