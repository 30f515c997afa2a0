"""The frames that are fused: which, from where, and with which depth."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.pose_readings import PoseReading, find_reading
from col3d.data.processes import frames_bar
from col3d.data.resize import Resize
from col3d.errors import DataError
from col3d.inference.options import PoseOptions
from col3d.inference.predictor import Predictor

FAR_OFF = 5.0
"""Millimetres at the upper end of the colours of errors."""


@dataclass(frozen=True)
class FusionFrame:
    """A frame at the network's size, its pose, its true depth and what the network says of it.

    The mask is where depth is known, or where the endoscope shows anything if the video has no truth.
    """

    image: UInt8[Tensor, "3 h w"]
    depth: Float[Tensor, "1 h w"]
    mask: Bool[Tensor, "1 h w"]
    pose: Float[np.ndarray, "4 4"]
    predicted: Float[Tensor, "1 h w"] | None


def poses_of(frames: C3VD, options: PoseOptions) -> dict[int, np.ndarray]:
    """Camera to world of each frame by its number, as depth bears it out."""
    stored = frames.poses(frames.frames[0].video).numpy()
    asked = options.model_dump(exclude={"check"})
    reading = PoseReading.of(asked)
    if options.check and frames.with_truth:
        found = find_reading(frames, stored, asked)
        reading = found.reading
        if found.note:
            print(f"note: {found.note}", flush=True)
    if not frames.with_truth:
        print(
            "note: without true depth nothing bears the poses out; they are read as C3VD's, or as said",
            flush=True,
        )
    poses = reading.camera_to_world(stored)
    placed = {frame.number: reading.of_frame(poses, frame.number) for frame in frames.frames}
    return {number: pose for number, pose in placed.items() if pose is not None}


def chosen_frames(frames: C3VD, poses: Mapping[int, np.ndarray], most: int | None) -> list[int]:
    """Places of frames, spread evenly over those that have a pose."""
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
    """The chosen frames at the size of the fusion, with what a network predicts of them."""
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
    """One factor for the whole video: the median over frames of the ratio of medians."""
    ratios = [
        (frame.depth[frame.mask].median() / frame.predicted[frame.mask].median()).item()
        for frame in seen
        if frame.predicted is not None and frame.mask.any()
    ]
    return float(np.median(ratios))
