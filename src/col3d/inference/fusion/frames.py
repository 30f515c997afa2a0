"""The frames to fuse: their choice, their poses, and their true and predicted depth."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.processes import frames_bar
from col3d.data.resize import Resize
from col3d.errors import DataError
from col3d.inference.fusion.pose_readings import PoseReading, find_reading
from col3d.inference.options import PoseOptions
from col3d.inference.predictor import Predictor

FAR_OFF = 5.0
"""Error in mm at the upper end of the colour scale."""


@dataclass(frozen=True)
class FusionFrame:
    """A frame at the network's size, with its pose, true depth and predicted depth.

    The mask is True where depth is known; without ground truth, where the endoscope shows anything.
    """

    image: UInt8[Tensor, "3 h w"]
    depth: Float[Tensor, "1 h w"]
    mask: Bool[Tensor, "1 h w"]
    pose: Float[np.ndarray, "4 4"]
    predicted: Float[Tensor, "1 h w"] | None


def poses_of(frames: C3VD, options: PoseOptions) -> dict[int, np.ndarray]:
    """Return the camera-to-world pose of each frame by number, in the reading that depth confirms."""
    stored = frames.poses(frames.frames[0].video).numpy()
    given = options.model_dump(exclude={"check"})
    reading = PoseReading.of(given)
    if options.check and frames.with_truth:
        result = find_reading(frames, stored, given)
        reading = result.reading
        if result.note:
            print(f"note: {result.note}", flush=True)
    if not frames.with_truth:
        print(
            "note: without true depth nothing bears the poses out; they are read as C3VD's, or as said",
            flush=True,
        )
    poses = reading.camera_to_world(stored)
    placed = {frame.number: reading.of_frame(poses, frame.number) for frame in frames.frames}
    return {number: pose for number, pose in placed.items() if pose is not None}


def chosen_frames(frames: C3VD, poses: Mapping[int, np.ndarray], most: int | None) -> list[int]:
    """Choose indices of frames, spread evenly over those that have a pose."""
    posed = [place for place, frame in enumerate(frames.frames) if frame.number in poses]
    if not posed:
        raise DataError(f"{frames.root}: no line of pose.txt is of a frame there")
    if missing := len(frames) - len(posed):
        print(
            f"note: {missing} of {len(frames)} frames have no line in pose.txt and are left out", flush=True
        )
    count = min(most or len(posed), len(posed))
    return [posed[round(place)] for place in np.linspace(0, len(posed) - 1, count)]


def seen_frames(
    frames: C3VD,
    chosen: Sequence[int],
    poses: Mapping[int, np.ndarray],
    resize: Resize,
    network: Predictor | None,
) -> Iterator[FusionFrame]:
    """Yield the chosen frames at the size of the fusion, with a network's prediction."""
    camera = resize.resized_camera
    view = octagon_mask(camera.size_hw)
    with frames_bar("read" if network is None else "read and predict") as bar:
        for place in bar.track(chosen):
            item = resize.read(frames, place)
            predicted = None
            if network is not None:
                predicted = network.predict(item["image"][None], camera)["depth"][0].cpu()
            pose = poses[frames.frames[place].number]
            mask = item["mask"] if frames.with_truth else view
            yield FusionFrame(item["image"], item["depth"], mask, pose, predicted)


def median_scale(seen: Sequence[FusionFrame]) -> float:
    """Compute one scale factor for the whole video: the median over frames of the ratio of medians."""
    ratios = [
        (frame.depth[frame.mask].median() / frame.predicted[frame.mask].median()).item()
        for frame in seen
        if frame.predicted is not None and frame.mask.any()
    ]
    return float(np.median(ratios))
