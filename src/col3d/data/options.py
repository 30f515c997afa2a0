"""Options of any data set: its location, its split, and how its frames are fed."""

from collections.abc import Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, PositiveFloat, PositiveInt, SerializeAsAny, model_validator

from col3d.errors import OptionError
from col3d.registry import DATASETS, Part
from col3d.registry.schema import Options, defaults

Split = Literal["train", "val", "test"]
Probability = Annotated[float, Field(ge=0, le=1)]
Side = Annotated[int, Field(ge=64)]
"""Side in pixels of frames that networks see: a batch of one needs more than one cell at 1/32."""
Size = Annotated[list[Side], Field(min_length=2, max_length=2)]
"""Height and width."""


class SplitOptions(Options):
    """Videos, labels of the paper or frame ranges of each part."""

    name: str
    train: list[str]
    val: list[str]
    test: list[str]

    def needs(self, option: str, *parts: Split) -> None:
        """Refuse parts that are used but empty.

        Raises:
            ValueError: names the option.
        """
        for part in parts:
            if not getattr(self, part):
                raise ValueError(f"{option}.{part}: a value is needed; give {option}.{part}=[VIDEO,...]")


class AugmentOptions(Options):
    """Random transforms of training batches."""

    rotation: Annotated[float, Field(ge=0, le=180)]
    flip: Probability
    crop: Annotated[float, Field(gt=0, le=1)]
    jitter: Probability


class SourceOptions(Options):
    """A data set and its split; the parameters of its class join these."""

    name: str
    root: str
    normals: Literal["stored", "derived", "none"]
    split: SplitOptions
    allow_missing: bool
    store: str = "auto"
    weight: PositiveFloat = 1.0

    @property
    def own(self) -> dict[str, Any]:
        """Options of the data set's class."""
        return DATASETS[self.name].own(self)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the values alone: the class is made from a signature, anew in each process."""
        return (data_options if isinstance(self, DataOptions) else source_options), (self.model_dump(),)


class DataOptions(SourceOptions):
    """The data set that is trained on, how its frames are fed, and others to test on or train on."""

    size: Size
    batch_size: PositiveInt
    workers: Annotated[int, Field(ge=0)]
    augment: AugmentOptions
    test: "Source | None" = None
    also: "dict[str, Source]" = Field(default_factory=dict)

    @model_validator(mode="after")
    def _belong_together(self) -> "DataOptions":
        for name, source in self.also.items():
            source.split.needs(f"data.also.{name}.split", "train")
            if (source.normals == "none") != (self.normals == "none"):
                raise ValueError(
                    f"data.also.{name}.normals: all that is trained on has normals or none has; got "
                    f"{source.normals} beside {self.normals}"
                )
        if self.test is not None:
            self.test.split.needs("data.test.split", "test")
        return self

    @property
    def tested(self) -> SourceOptions:
        """Options of the data set that is tested on."""
        return self.test or self

    def fed(self, source: SourceOptions) -> "DataOptions":
        """Options of another data set, alone, with this one's size, batch size, workers and transforms."""
        feeding = {name: getattr(self, name) for name in ("size", "batch_size", "workers", "augment")}
        return data_options({**source.model_dump(), **feeding, "test": None, "also": {}})


def source_options(given: Any) -> SourceOptions:
    """Options of a registered data set, checked against its signature.

    Raises:
        ValueError: nothing has that name; pydantic's for single options.
    """
    return given if isinstance(given, SourceOptions) else _checked(given, SourceOptions)


def data_options(given: Any) -> DataOptions:
    """Options of a registered data set and of how its frames are fed, checked likewise.

    Raises:
        ValueError: as `source_options`.
    """
    options = given if isinstance(given, DataOptions) else _checked(given, DataOptions)
    assert isinstance(options, DataOptions)
    return options


def _checked(given: Any, base: type[SourceOptions]) -> SourceOptions:
    if not isinstance(given, Mapping) or "name" not in given:
        raise OptionError(f"data.name: a value is needed, got {given!r}")
    part = DATASETS[str(given["name"])]
    options = part.options(base).model_validate(given)
    assert isinstance(options, SourceOptions)
    if options.normals == "stored" and "normals" not in getattr(part.build, "kinds", ()):
        raise OptionError(f"data.normals: {options.name} stores none; take derived or none")
    return options


Source = Annotated[SerializeAsAny[SourceOptions], PlainValidator(source_options)]
Data = Annotated[SerializeAsAny[DataOptions], PlainValidator(data_options)]
DataOptions.model_rebuild()


def of_the_table() -> list[str]:
    """Names of the data sets whose videos are those of `videos.csv`."""
    return [name for name in DATASETS.names() if DATASETS[name].facts["table"]]


def built(source: SourceOptions, entries: Sequence[str], **supplied: Any) -> Any:
    """Frames of these entries at full resolution, built by the data set's registered class.

    Args:
        source: options of the data set.
        entries: entries of a split; if empty, the set has no frames but can look for them.
        supplied: further arguments, passed to classes that take them.

    Raises:
        DataError: a file or folder is missing or not what it should be. What goes wrong inside of a user's
            own class keeps its traceback.
    """
    build = DATASETS[source.name].build
    given = {"root": Path(source.root), "videos": entries, "normals": source.normals, **supplied}
    takes = signature(build).parameters
    return build(**source.own, **{name: value for name, value in given.items() if name in takes})


def source_node(part: Part) -> dict[str, Any]:
    """Configuration node of `data/source=NAME`: every option with its default."""
    facts = part.facts
    return {
        "defaults": [{"/data/split@split": facts["split"]}, "_self_"],
        "name": part.name,
        "root": facts["root"],
        "normals": facts["normals"],
        "allow_missing": False,
        "store": "auto",
        "weight": 1.0,
        **defaults(part.parameters()),
        **facts["defaults"],
    }


def node(part: Part) -> dict[str, Any]:
    """Configuration node of `data=NAME`: the data set, and how frames are fed."""
    return {"defaults": [f"source/{part.name}@_here_", "loading/default@_here_"]}
