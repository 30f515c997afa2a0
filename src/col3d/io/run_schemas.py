"""Schemas of the JSON files of runs; a file that does not fit counts as broken and ends no program."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
Scores = dict[str, Finite | None]
"""Scores by name; null where a number was not finite."""


class _Shape(BaseModel):
    """Base of schemas: checks the fields that are read and keeps all others."""

    model_config = ConfigDict(extra="allow", strict=True)


class _Status(_Shape):
    state: str = ""
    seconds: Annotated[Finite, Field(ge=0)] = 0.0
    sessions: Count = 0
    epoch: Count = 0
    epochs: Count | None = None
    host: str = ""
    process: Count = 0
    error: str = ""


class _Result(_Shape):
    best: Annotated[Scores, Field(min_length=1)]


class _Plan(_Shape):
    commands: list[str] = []
    jobs: dict[str, list[str]] = {}


class _Video(_Shape):
    frames: Count
    __pydantic_extra__: Scores = Field(init=False)


class _Spec(_Shape):
    task: str = ""
    better: Literal["lower", "higher"] | None = None
    unit: str = ""
    heading: str = ""
    latex: str = ""
    decimals: Annotated[int, Field(ge=0, le=12)] = 3
    scale: Finite = 1.0
    over_pixels: str | None = None
    in_validation: bool = True
    undefined: bool = True
    short: str = ""
    short_decimals: Annotated[int, Field(ge=0, le=12)] | None = None
    on_screen: bool = True
    by_video: bool = True
    further: bool = False


class _Cost(_Shape):
    parameters: Count = 0
    gflop: Finite | None = None
    frames_per_second: Finite | None = None
    size: Annotated[list[Count], Field(min_length=2, max_length=2)] | None = None


class _Summary(_Shape):
    model: str
    seed: Count | None
    data: str
    split: str
    protocol: str
    frames: Count
    metrics: Scores
    videos: dict[str, _Video]
    split_name: str = ""
    average: str = ""
    frames_without_truth: Count = 0
    baseline: Scores = {}
    best: Scores | None = None
    size: list[Count] | None = None
    versions: dict[str, str] = {}
    parameters: Count = 0
    cost: _Cost | None = None
    frames_by_split: dict[str, Count] = {}
    command: str | None = None
    commit: str | None = None
    checkpoint: str | None = None
    metric_specs: dict[str, _Spec] = {}
    label: str = ""
    colour: Annotated[str, Field(pattern="^(#[0-9A-Fa-f]{6})?$")] = ""


SHAPES: dict[str, type[_Shape]] = {
    "status.json": _Status,
    "result.json": _Result,
    "sweep.json": _Plan,
    "summary.json": _Summary,
}
"""Schemas by file name."""


def misfit(name: str, content: Any) -> str:
    """Describe the first value that does not fit the schema of a file; empty if all fit.

    Args:
        name: file name, without its folder.
        content: parsed content of the file.
    """
    if not isinstance(content, dict):
        return f"expected an object, got {type(content).__name__}"
    try:
        SHAPES.get(name, _Shape).model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"] if not str(part).startswith("constrained"))
        return f"{place}: {first['msg'].replace('Input should be', 'expected')}"
    return ""


def read_object(path: Path) -> dict[str, Any]:
    """Read a JSON object and check it against the schema of its file name.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no JSON, or does not fit the schema; the message says why.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if wrong := misfit(path.name, content):
        raise ValueError(wrong)
    return dict(content)
