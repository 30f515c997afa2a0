"""Ground truth of protocols that score at native resolution, or against truth resized as published."""

from collections.abc import Iterator, Mapping, Sequence

import torch

from col3d.batch import Batch
from col3d.data.build import full_frames
from col3d.data.datamodule import FrameDataModule, Frames
from col3d.data.options import SourceOptions
from col3d.data.sized import WithTruthOf
from col3d.evaluation.options import ProtocolOptions
from col3d.phantom.options import PhantomOptions


def own_truths(
    protocols: Mapping[str, ProtocolOptions],
    source: SourceOptions,
    phantom: PhantomOptions,
    part: str,
    size: Sequence[int],
) -> dict[str, Frames | None]:
    """Return the frames of protocols with their own ground truth: at native resolution, or as published.

    Protocols that score against the batches themselves have None. Frames of full resolution are opened once,
    and only if a protocol needs them.

    Raises:
        DataError: a video is missing, or a file is invalid.
    """
    own = {name for name, options in protocols.items() if options.has_own_truth}
    if not own:
        return dict.fromkeys(protocols)
    whole = full_frames(source, phantom, part)

    def truth_of(options: ProtocolOptions) -> Frames:
        return (
            whole if options.resolution == "native" else WithTruthOf(whole, (size[0], size[1]), options.truth)
        )

    return {name: truth_of(options) if name in own else None for name, options in protocols.items()}


def one_by_one(frames: Frames | None, workers: int, device: torch.device) -> Iterator[Batch] | None:
    """Yield the frames of this process in batches of one, in the order of the predictions."""
    if frames is None:
        return None
    return FrameDataModule({"test": frames}, 1, workers).frames_in_order("test", device)
