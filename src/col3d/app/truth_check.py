"""Whether there is anything to learn from and to score on, before anything is learned."""

from collections.abc import Mapping

from col3d.app.config import DataOptions, ProtocolOptions
from col3d.checks import UserError
from col3d.data.datamodule import Frames
from col3d.data.sized import Joined


def check_truth(frames: Mapping[str, Frames], data: DataOptions, protocol: ProtocolOptions) -> None:
    """Refuse a data set without a pixel of valid depth; usually one frame of each is read for it.

    Raises:
        UserError: names the part and the folder.
    """
    for part, of_part in frames.items():
        span = protocol.truth_range if part == "test" else None
        sources = [data.tested if part == "test" else data, *(data.also.values() if part == "train" else ())]
        sets = of_part.parts if isinstance(of_part, Joined) else (of_part,)
        for source, of_source in zip(sources, sets, strict=False):
            if has_truth(of_source, span):
                continue
            within = f" within protocol.truth_range={span}" if span else ""
            what = "learned from" if part == "train" else "scored on"
            raise UserError(
                f"data.split.{part}: none of its {_length(of_source)} frames in {source.root} has a pixel of "
                f"valid depth{within}: nothing can be {what}"
            )


def has_truth(frames: Frames, span: list[float] | None = None) -> bool:
    """Whether any pixel of any frame has valid depth, between two depths in mm where they are given."""
    for index in range(_length(frames)):
        frame = frames[index]
        valid = frame["mask"]
        if span is not None:
            valid = valid & (frame["depth"] > span[0]) & (frame["depth"] < span[1])
        if bool(valid.any()):
            return True
    return False


def _length(frames: Frames) -> int:
    return len(frames)  # type: ignore[arg-type]
