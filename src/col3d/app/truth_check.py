"""Whether there is anything to learn from and to score on, before anything is learned."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from torch import Tensor

from col3d.app.config import DataOptions, ProtocolOptions, SourceOptions
from col3d.batch import normals_mask
from col3d.checks import UserError
from col3d.data.datamodule import Frames
from col3d.data.sized import Joined, Resized, SizedFrames
from col3d.losses.gradients import with_neighbours


def check_truth(
    frames: Mapping[str, Frames],
    data: DataOptions,
    protocol: ProtocolOptions,
    learns_normals: bool = False,
    say: Callable[[str], None] = print,
) -> None:
    """Refuse a data set without a pixel of valid depth; usually one frame of each is read for it.

    Of truth with holes, `say` is told how much of it counts.

    Raises:
        UserError: names the part and the folder.
    """
    for part, source, of_source in _sets(frames, data):
        span = protocol.truth_range if part == "test" else None
        frame = first_with_truth(of_source, span)
        if frame is None:
            within = f" within protocol.truth_range={span}" if span else ""
            what = "learned from" if part == "train" else "scored on"
            raise UserError(
                f"data.split.{part}: none of its {_length(of_source)} frames in {source.root} has a pixel of "
                f"valid depth{within}: nothing can be {what}"
            )
        if learns_normals and part == "train" and "normals" in frame and not _has_normals(of_source):
            raise UserError(
                f"data.split.train: none of its {_length(of_source)} frames in {source.root} has a pixel of "
                f"known normals (data.normals={source.normals}), which this loss learns from; take a data "
                "set that has them, or a model or loss without normals"
            )
        if isinstance(of_source, SizedFrames) and not of_source.dense_truth and part != "val":
            say(f"note: {source.root}: {_shares(of_source, frame)}")


def has_truth(frames: Frames, span: list[float] | None = None) -> bool:
    """Whether any pixel of any frame has valid depth, between two depths in mm where they are given."""
    return first_with_truth(frames, span) is not None


def first_with_truth(frames: Frames, span: list[float] | None = None) -> dict[str, Any] | None:
    """The first frame with a pixel of valid depth, between two depths in mm where they are given."""
    for index in range(_length(frames)):
        frame: dict[str, Any] = frames[index]
        valid = frame["mask"]
        if span is not None:
            valid = valid & (frame["depth"] > span[0]) & (frame["depth"] < span[1])
        if bool(valid.any()):
            return {**frame, "index": index}
    return None


def _sets(frames: Mapping[str, Frames], data: DataOptions) -> Iterator[tuple[str, SourceOptions, Frames]]:
    """Each data set of each part, with its options."""
    for part, of_part in frames.items():
        sources = [data.tested if part == "test" else data, *(data.also.values() if part == "train" else ())]
        sets = of_part.parts if isinstance(of_part, Joined) else (of_part,)
        for source, of_source in zip(sources, sets, strict=False):
            yield part, source, of_source


def _has_normals(frames: Frames) -> bool:
    return any(bool((frames[index]["normals"] != 0).any()) for index in range(_length(frames)))


def _shares(frames: SizedFrames, frame: Mapping[str, Any]) -> str:
    """How much of a frame's truth counts, in words."""
    height, width = frame["mask"].shape[-2:]
    said = (
        f"{frame['video']}, frame {int(frame['frame'])} has depth at {_percent(frame['mask'])} of its pixels"
    )
    said += f" at {height} x {width}"
    if isinstance(frames, Resized):
        said += f" ({_percent(frames.frames.truth(frame['index'])['mask'])} of those of its files)"
    if "normals" in frame:
        batch: Any = {key: frame[key][None] for key in ("mask", "normals")}
        said += f", normals at {_percent(normals_mask(batch))}"
    whole = with_neighbours(frame["mask"][None])
    return said + f"; losses that compare neighbours (gradients, consistency) count {_percent(whole)}"


def _percent(mask: Tensor) -> str:
    return f"{100 * mask.float().mean().item():.1f} %"


def _length(frames: Frames) -> int:
    return len(frames)  # type: ignore[arg-type]
