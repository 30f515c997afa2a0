"""Depth and normals that any program predicted: files found, matched to the scored frames, and read."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32
from rich.box import SIMPLE_HEAD
from rich.table import Table
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.data.datasets.videos import described
from col3d.data.files.arrays import array_header, is_array, read_array
from col3d.data.files.decode import read_whole
from col3d.data.files.depth_files import check_format, check_numbers
from col3d.data.sized import SizedFrames
from col3d.errors import DataError
from col3d.evaluation.options import EvaluateOptions, ReadingOptions
from col3d.evaluation.predict_frames import Mirror
from col3d.reports.screen import plain_console

SUFFIXES = (".npy", ".npz", ".pfm", ".png", ".tif", ".tiff")
STACKS = (".npy", ".npz")
"""Endings of files that hold the frames of a whole video."""
LAST_NUMBER = re.compile(r"(.*?)(\d+)(\D*)")
DEPTH_WORDS, NORMAL_WORDS = ("depth", "disp"), ("normal",)
LISTED = 5
UNITS = {1e-3: "metres", 0.1: "centimetres", 1e3: "micrometres"}
"""Factor between depth in a unit and in mm -> the unit."""
SIGNS = {"standard": (1.0, 1.0, 1.0), "opengl": (1.0, -1.0, -1.0)}
"""Signs of x, y and z by the axes of stored normals; OpenGL is also what C3VD had before May 2023."""


@dataclass(frozen=True)
class Place:
    """Where the prediction of a frame is: a file, or a frame of the array of a whole video."""

    path: Path
    index: int | None = None


@dataclass(frozen=True)
class Matched:
    """Predictions of a video.

    Attributes:
        places: by number of the frame.
        others: number of files, or frames of an array, that belong to no scored frame.
        how: where they are and how they were matched, for a table.
    """

    places: Mapping[int, Place]
    others: int
    how: str


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
        videos: dict[str, list[int]] = {}
        for video, number in frames:
            videos.setdefault(video, []).append(number)
        self.depth = self._matched(videos, reading.depth, "depth")
        self.normals = self._matched(videos, reading.normals, "normals") if reading.normals else {}

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
        values = _plane(place, _read(place)).astype(np.float32)
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
        values = _read(place)
        if values.ndim != 3 or 3 not in (values.shape[0], values.shape[-1]):
            raise DataError(
                f"{place.path}: expected normals (h, w, 3) or (3, h, w), got shape {values.shape}"
            )
        channels = values if values.shape[0] == 3 else np.moveaxis(values, -1, 0)
        if channels.dtype.kind in "ui":
            channels = channels.astype(np.float32) / np.iinfo(channels.dtype).max * 2 - 1
        signs = np.array(SIGNS[self.reading.axes], np.float32)[:, None, None]
        return channels.astype(np.float32) * signs

    def _matched(
        self, videos: Mapping[str, Sequence[int]], name: str | None, kind: str
    ) -> dict[str, Matched]:
        return {
            video: self._of_video(video, numbers, name, kind, len(videos) > 1)
            for video, numbers in videos.items()
        }

    def _of_video(
        self, video: str, numbers: Sequence[int], name: str | None, kind: str, several: bool
    ) -> Matched:
        names = _names(video)
        for stem in names if name is None else ():
            for suffix in STACKS:
                if (path := self.folder / f"{stem}{suffix}").is_file():
                    return self._of_stack(path, numbers)
        place = next((self.folder / stem for stem in names if (self.folder / stem).is_dir()), None)
        if place is None:
            if several:
                raise DataError(
                    f"predictions={self.folder}: no folder and no array of {video} in it; looked for "
                    f"{', '.join(names)}, and {names[0]}.npy or .npz"
                )
            place = self.folder
        files = _named(place, name, kind) if name is not None else _found(place, kind)
        if self.reading.order == "position":
            return self._in_order(place, files, numbers)
        missing = [number for number in numbers if number not in files]
        if missing:
            listed = ", ".join(map(str, missing[:LISTED])) + (", ..." if len(missing) > LISTED else "")
            if len(files) == len(numbers):
                listed += f"; as many files are numbered {min(files)} to {max(files)}: reading.order=position"
            raise DataError(f"{place}: {len(missing)} of {len(numbers)} frames have no {kind}: {listed}")
        others = len(files) - len(numbers)
        return Matched({n: Place(files[n]) for n in numbers}, others, f"{place.name}/, by number")

    def _in_order(self, place: Path, files: Mapping[int, Path], numbers: Sequence[int]) -> Matched:
        if len(files) != len(numbers):
            raise DataError(
                f"{place}: {len(files)} files for {len(numbers)} frames: reading.order=position takes as many"
            )
        pairs = zip(sorted(numbers), sorted(files), strict=True)
        return Matched({number: Place(files[k]) for number, k in pairs}, 0, f"{place.name}/, in order")

    def _of_stack(self, path: Path, numbers: Sequence[int]) -> Matched:
        shape = array_header(path).shape
        if len(shape) not in (3, 4):
            raise DataError(f"{path}: expected the frames of a video, (n, h, w), got shape {shape}")
        count = shape[0]
        if count == len(numbers) and (self.reading.order == "position" or count <= max(numbers)):
            places = {number: Place(path, index) for index, number in enumerate(sorted(numbers))}
            return Matched(places, 0, f"{path.name}, in order")
        if count <= max(numbers):
            raise DataError(
                f"{path}: {count} frames, which are neither the {len(numbers)} that are scored nor a video "
                f"up to frame {max(numbers)}"
            )
        places = {number: Place(path, number) for number in numbers}
        return Matched(places, count - len(numbers), f"{path.name}, by number")


def _names(video: str) -> list[str]:
    """Names that a video may go by: here, in its data set today, in the paper."""
    known = described(video)
    others = (known.released_as, known.label) if known is not None else ()
    return list(dict.fromkeys([video, *(name for name in others if name)]))


def _named(place: Path, name: str, kind: str) -> dict[int, Path]:
    """Files whose name is as given, {} for the number."""
    before, after = (re.escape(part) for part in name.split("{}"))
    pattern = re.compile(f"{before}(\\d+){after}")
    paths = sorted(path for path in place.rglob("*") if path.is_file())
    files = {
        int(match[1]): path
        for path in paths
        if (match := pattern.fullmatch(path.relative_to(place).as_posix()))
    }
    if not files:
        raise DataError(f"{place}: no file is called as reading.{kind}={name} says")
    return files


def _found(place: Path, kind: str) -> dict[int, Path]:
    """The one series of numbered files of a folder that may be of a kind."""
    series: dict[tuple[str, str, str], dict[int, Path]] = {}
    for path in sorted(place.iterdir()):
        if path.suffix.lower() in SUFFIXES and (match := LAST_NUMBER.fullmatch(path.stem)):
            key = match[1], match[3], path.suffix
            series.setdefault(key, {})[int(match[2])] = path
    words, others = (DEPTH_WORDS, NORMAL_WORDS) if kind == "depth" else (NORMAL_WORDS, DEPTH_WORDS)
    fitting = {key: files for key, files in series.items() if not _says(key, others)}
    if len(fitting) > 1:
        fitting = {key: files for key, files in fitting.items() if _says(key, words)}
    if len(fitting) != 1:
        listed = ", ".join(f"{before}{{}}{after}{suffix}" for before, after, suffix in list(series)[:LISTED])
        what = f"several kinds of files ({listed})" if series else f"no numbered {'/'.join(SUFFIXES)}"
        raise DataError(f"{place}: {what}; name those of {kind} by reading.{kind}=NAME_{{}}.npy")
    return next(iter(fitting.values()))


def _says(key: tuple[str, str, str], words: Sequence[str]) -> bool:
    return any(word in part.lower() for part in key[:2] for word in words)


def _read(place: Place) -> np.ndarray:
    if is_array(place.path):
        values = read_array(place.path)
    else:
        check_format(place.path)
        values = read_whole(place.path)
    check_numbers(place.path, values.dtype)
    return values if place.index is None else values[place.index]


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
