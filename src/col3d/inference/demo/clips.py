"""Prediction of a short video, written with depth and normals side by side."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from col3d.errors import DataError
from col3d.inference.cameras import CameraOption, camera_at, lens_of, view_of
from col3d.inference.demo.answer import predicted
from col3d.inference.demo.uploads import Clip
from col3d.inference.predictor import Predictor
from col3d.layers.network import needs_rays
from col3d.reports.previews import SideBySide, depth_picture, normals_picture
from col3d.reports.video import VideoWriter

CLIP_SIDE = 320
"""Pixels of the longer side of each picture."""


def write_clip(
    network: Predictor, clip: Clip, option: CameraOption, path: Path, progress: Callable[[float], None]
) -> tuple[float, float]:
    """Predict every frame, then write image, depth and normals side by side.

    Args:
        network: the predictor.
        clip: frames of one size.
        option: the camera; see `lens_of`.
        path: path of the MP4 file.
        progress: called with the share of frames that are done.

    Returns:
        The range of depth that the colours span, over the whole video.

    Raises:
        DataError: the camera does not fit the frames, or is required and missing.
        OSError: the video cannot be written.
    """
    size_hw = (clip.frames[0].shape[0], clip.frames[0].shape[1])
    lens = lens_of(option)
    if lens is None and needs_rays(network.network):
        raise DataError("camera: this network needs the camera's viewing rays; choose one")
    camera = None if lens is None else camera_at(lens, size_hw)
    view = view_of(option, size_hw)
    mask = np.ones(size_hw, bool) if view is None else view[0].numpy()
    answers = []
    for number, frame in enumerate(clip.frames):
        answers.append(predicted(network, frame, camera))
        progress((number + 1) / len(clip.frames))
    largest = max(depth.max() for depth, _ in answers) if camera is None else 1.0
    depths = [depth / largest for depth, _ in answers]
    low, high = (float(np.quantile([depth[mask] for depth in depths], share)) for share in (0.01, 0.99))
    titles = ["image", "depth"] + ["normals"] * (answers[0][1] is not None)
    page = SideBySide(titles, size_hw, low, high, "relative" if camera is None else "mm")
    writer = VideoWriter(path, clip.fps)
    for frame, depth, (_, normals) in zip(clip.frames, depths, answers, strict=True):
        pictures = [frame, depth_picture(depth, low, high, mask)]
        pictures += [] if normals is None else [normals_picture(normals, mask)]
        writer.add(page(pictures))
    writer.close()
    return low, high
