"""Read depth and normals that any program predicted, from files matched to the scored frames."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32
from rich.box import SIMPLE_HEAD
from rich.table import Table
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.data.files.arrays import is_array, read_array
from col3d.data.files.decode import read_whole
from col3d.data.files.depth_files import check_format, check_numbers
from col3d.data.sized import SizedFrames
from col3d.errors import DataError
from col3d.evaluation.match_predictions import Place, match
from col3d.evaluation.options import EvaluateOptions, ReadingOptions
from col3d.evaluation.predict_frames import Mirror
from col3d.reports.screen import plain_console

UNITS = {1e-3: "metres", 0.1: "centimetres", 1e3: "micrometres"}
"""Factor between depth in a unit and in mm -> the unit."""
SIGNS = {"standard": (1.0, 1.0, 1.0), "opengl": (1.0, -1.0, -1.0)}
"""Signs of x, y and z by the axes of stored normals; OpenGL is also what C3VD had before May 2023."""


class PredictionFiles:
    """Predictions of frames, in files that another program wrote.

    Args:
        folder: of the files, or of a folder for each video.
        reading: how they are named and what their numbers mean.
        frames: scored frames, as pairs (video, number).

    Attributes:
        depth: matched files of depth, by video.
        normals: those of normals; empty where none are named.

    Raises:
        DataError: a frame has no prediction, or it cannot be told which file it is.
    """

    def __init__(self, folder: Path, reading: ReadingOptions, frames: Sequence[tuple[str, int]]) -> None:
        if not folder.is_dir():
            raise DataError(f"predictions={folder}: no such folder")
        self.folder, self.reading = folder, reading
        self._opened: tuple[Path, np.ndarray] | None = None
        videos: dict[str, list[int]] = {}
        for video, number in frames:
            videos.setdefault(video, []).append(number)
        self.depth = match(folder, reading, videos, "depth")
        self.normals = match(folder, reading, videos, "normals") if reading.normals else {}

    def predicted(self, batch: Batch) -> tuple[Batch, dict[Mirror, Prediction]]:
        """A batch with the predictions of its frames, all of one size.

        Raises:
            DataError: a file is not what it should be, or frames of a batch differ in size.
        """
        pairs = list(zip(batch["video"], batch["frame"].tolist(), strict=True))
        device = batch["depth"].device
        prediction: Prediction = {"depth": _stacked([self.read_depth(*pair) for pair in pairs]).to(device)}
        if self.normals:
            prediction["normals"] = _stacked([self.read_normals(*pair) for pair in pairs]).to(device)
        return batch, {None: prediction}

    def read_depth(self, video: str, number: int) -> Float32[np.ndarray, "1 h w"]:
        """Depth of a frame in mm, or in its own unit where it has none.

        Raises:
            DataError: the file is not what it should be.
        """
        place = self.depth[video].places[number]
        values = _plane(place, self._read(place)).astype(np.float32)
        if not np.isfinite(values).all():
            raise DataError(
                f"{place.path}: {int((~np.isfinite(values)).sum())} of its numbers are not finite"
            )
        unit = np.float32(self.reading.unit or 1.0)
        if self.reading.holds == "depth":
            return (values * unit)[None]
        with np.errstate(divide="ignore"):
            return (unit / np.maximum(values, np.float32(1e-6) * values.max(initial=1e-30)))[None]

    def read_normals(self, video: str, number: int) -> Float32[np.ndarray, "3 h w"]:
        """Normals of a frame in standard axes, of whatever length they are stored in.

        Raises:
            DataError: the file is not what it should be.
        """
        place = self.normals[video].places[number]
        values = self._read(place)
        if values.ndim != 3 or 3 not in (values.shape[0], values.shape[-1]):
            raise DataError(
                f"{place.path}: expected normals (h, w, 3) or (3, h, w), got shape {values.shape}"
            )
        channels = values if values.shape[0] == 3 else np.moveaxis(values, -1, 0)
        if channels.dtype.kind in "ui":
            channels = channels.astype(np.float32) / np.iinfo(channels.dtype).max * 2 - 1
        signs = np.array(SIGNS[self.reading.axes], np.float32)[:, None, None]
        return channels.astype(np.float32) * signs

    def _read(self, place: Place) -> np.ndarray:
        if place.index is None:
            return _numbers(place.path)
        if self._opened is None or self._opened[0] != place.path:  # the array of a video is read once
            self._opened = place.path, _numbers(place.path)
        values: np.ndarray = self._opened[1][place.index]
        return values


def _numbers(path: Path) -> np.ndarray:
    if is_array(path):
        values = read_array(path)
    else:
        check_format(path)
        values = read_whole(path)
    check_numbers(path, values.dtype)
    return values


def _plane(place: Place, values: np.ndarray) -> np.ndarray:
    """A map (h, w) of one that may have an axis of length 1, or equal channels."""
    values = values.squeeze()
    if values.ndim == 3 and values.shape[-1] in (3, 4) and (values[..., :1] == values[..., :3]).all():
        values = values[..., 0]
    if values.ndim != 2:
        raise DataError(f"{place.path}: expected one map (h, w), got shape {values.shape}")
    return values


def _stacked(maps: Sequence[np.ndarray]) -> Tensor:
    sizes = {values.shape[-2:] for values in maps}
    if len(sizes) > 1:
        listed = " and ".join(f"{height} x {width}" for height, width in sorted(sizes))
        raise DataError(f"predictions: frames differ in size: {listed}")
    return torch.from_numpy(np.stack(maps))


def check_scale(
    files: PredictionFiles, frames: Sequence[tuple[str, int]], median_of: Callable[[int], float]
) -> None:
    """Refuse depth that is far from the truth by a factor that a unit explains.

    Args:
        files: the predictions.
        frames: scored frames.
        median_of: index of a frame -> median of its true depth in mm, NaN where none is known.

    Raises:
        DataError: names the factor and the unit that would mend it.
    """
    few = range(0, len(frames), max(1, len(frames) // 8))
    ratios = [float(np.median(files.read_depth(*frames[i]))) / median_of(i) for i in few]
    ratios = [ratio for ratio in ratios if np.isfinite(ratio)]
    if not ratios:
        return
    ratio = float(np.median(ratios))
    unit = files.reading.unit or 1.0
    for factor, name in UNITS.items():
        if 0.4 < ratio / factor < 2.5:
            raise DataError(
                f"predictions={files.folder}: their median is {ratio:.2g} of the true one: are these {name}? "
                f"reading.unit={unit / factor:g}"
            )
    if not 1 / 20 < ratio < 20:
        raise DataError(
            f"predictions={files.folder}: their median is {ratio:.3g} times the true one; reading.unit is "
            "the millimetres of 1 in a file, reading.holds=inverse_depth is for disparity, and "
            "reading.unit=null leaves the scale to a protocol that fits it"
        )


def matched_files(options: EvaluateOptions, frames: SizedFrames) -> PredictionFiles:
    """The files of predictions of all frames, after their table is printed and their scale is checked.

    Raises:
        DataError: a frame has no prediction, or their unit cannot be right.
    """
    assert options.predictions is not None
    listed = list(zip(frames.videos, frames.numbers, strict=True))
    files = PredictionFiles(Path(options.predictions), options.reading, listed)
    print_matched(files)

    def median_of(index: int) -> float:
        frame = frames[index]
        return float(frame["depth"][frame["mask"]].median()) if bool(frame["mask"].any()) else math.nan

    if any(protocol.scaling == "none" for protocol in options.protocol.values()):
        check_scale(files, listed, median_of)
    return files


def print_matched(files: PredictionFiles) -> None:
    """Print which files were matched to the frames of each video, and the size of the first."""
    table = Table(title=f"Predictions in {files.folder}", title_justify="left", box=SIMPLE_HEAD)
    for heading in ("video", "frames", "others", "size", "where"):
        table.add_column(heading, justify="right" if heading in ("frames", "others") else "left")
    for video, matched in files.depth.items():
        height, width = files.read_depth(video, next(iter(matched.places))).shape[-2:]
        table.add_row(
            video, str(len(matched.places)), str(matched.others), f"{height} x {width}", matched.how
        )
    plain_console().print(table)
