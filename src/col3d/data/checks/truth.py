"""Check before a training that there is ground truth to learn from and to score on."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from torch import Tensor

from col3d.batch import normals_mask
from col3d.data.datamodule import Frames
from col3d.data.options import DataOptions, SourceOptions
from col3d.data.sized import Joined, Resized, SizedFrames
from col3d.errors import UserError
from col3d.losses.gradients import with_neighbours

NEARLY_ALL = 0.95
"""Share of a frame's pixels with depth from which on there is no note."""
LEAST_MM = 1.0
"""Median depth below which its unit is in doubt: no endoscope is that near to all that it sees."""
UNIT = "data.layout.depth_unit"


def check_truth(
    frames: Mapping[str, Frames],
    data: DataOptions,
    truth_range: list[float],
    learns_normals: bool = False,
    say: Callable[[str], None] = print,
) -> None:
    """Refuse a data set without a pixel of valid depth; usually one frame of each is read for it.

    For truth with holes, `say` is called with a line on how much of it counts.

    Raises:
        UserError: no frame of a part has valid depth, or known normals that the loss needs; names the folder.
    """
    for part, source, dataset in _sets(frames, data):
        span = truth_range if part == "test" else None
        frame = first_with_truth(dataset, span)
        if frame is None:
            within = f" within protocol.truth_range={span}" if span else ""
            purpose = "learned from" if part == "train" else "scored on"
            raise UserError(
                f"data.split.{part}: none of its {_length(dataset)} frames in {source.root} has a pixel of "
                f"valid depth{within}: nothing can be {purpose}{_depth_range(dataset, source)}"
            )
        taught = learns_normals and part == "train" and "normals" in frame
        if taught and not (
            _knows_normals(frame) or any(_knows_normals(dataset[i]) for i in range(_length(dataset)))
        ):
            raise UserError(
                f"data.split.train: none of its {_length(dataset)} frames in {source.root} has a pixel of "
                f"known normals (data.normals={source.normals}), which this loss learns from; take a data "
                "set that has them, or a model or loss without normals"
            )
        if part == "val" or not isinstance(dataset, SizedFrames) or dataset.dense_truth:
            continue
        if _share(frame["mask"]) < NEARLY_ALL:
            say(f"note: {source.root}: {_shares(dataset, frame)}")
        layout = source.own.get("layout")
        if layout is not None and (note := _too_near(frame, layout.depth_unit)):
            say(f"note: {source.root}: {note}")


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
    for part, part_frames in frames.items():
        sources = [data.tested if part == "test" else data, *(data.also.values() if part == "train" else ())]
        sets = part_frames.parts if isinstance(part_frames, Joined) else (part_frames,)
        for source, dataset in zip(sources, sets, strict=False):
            yield part, source, dataset


def _too_near(frame: Mapping[str, Any], unit: float) -> str:
    """A note on depth that an endoscope is hardly ever at; empty for any other."""
    median = float(frame["depth"][frame["mask"]].median())
    if median >= LEAST_MM:
        return ""
    where = f"depth of {frame['video']}, frame {int(frame['frame'])} is {median:.2g} mm in the median"
    return f"{where}; if its files are in metres, say {UNIT}={1000 * unit:g}"


def _depth_range(frames: Frames, source: SourceOptions) -> str:
    """Clause on the range of depth of a described folder in its unit, where none of it counts."""
    layout = source.own.get("layout")
    if not isinstance(frames, Resized) or layout is None:
        return ""
    stored = frames.frames.stored_depth(frames.frames.frames[0])
    mm = stored.mm[np.isfinite(stored.mm) & (stored.mm > 0)]
    if not len(mm):
        return ""
    return (
        f"; that of the first frame is read as {mm.min():.3g} to {mm.max():.3g} mm, and what counts is up to "
        f"data.layout.max_depth={layout.max_depth:g}: is {UNIT}={layout.depth_unit:g} right?"
    )


def _knows_normals(frame: Mapping[str, Any]) -> bool:
    return bool((frame["normals"] != 0).any())


def _shares(frames: SizedFrames, frame: Mapping[str, Any]) -> str:
    """A line on how much of a frame's truth counts."""
    height, width = frame["mask"].shape[-2:]
    text = (
        f"{frame['video']}, frame {int(frame['frame'])} has depth at {_percent(frame['mask'])} of its pixels"
    )
    text += f" at {height} x {width}"
    if isinstance(frames, Resized):
        text += f" ({_percent(frames.frames.truth(frame['index'])['mask'])} of those of its files)"
    if "normals" in frame:
        batch: Any = {key: frame[key][None] for key in ("mask", "normals")}
        text += f", normals at {_percent(normals_mask(batch))}"
    whole = with_neighbours(frame["mask"][None])
    return text + f"; losses that compare neighbours (gradients, consistency) count {_percent(whole)}"


def _share(mask: Tensor) -> float:
    return mask.float().mean().item()


def _percent(mask: Tensor) -> str:
    return f"{100 * _share(mask):.1f} %"


def _length(frames: Frames) -> int:
    return len(frames)  # type: ignore[arg-type]
