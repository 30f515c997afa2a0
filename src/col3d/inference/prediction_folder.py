"""Output folder of `col3d predict`: files of each frame, a table of frames, a video and a summary."""

import csv
import io
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
import torch
from PIL import Image

from col3d.data.files.images import ImageSource, SourceImage
from col3d.errors import naming
from col3d.geometry import Camera
from col3d.geometry.camera_file import plain_from_camera
from col3d.inference.options import PredictOptions
from col3d.inference.predicted_frame import Clouds, CodeFiles, Pictures, Predicted, sparse_depth
from col3d.inference.prediction_place import CHART, FILES, PARTS, SUMMARY, TABLE, VIDEO, check_room
from col3d.inference.predictor import Predictor
from col3d.io.atomic import write_whole
from col3d.io.json_files import write_json
from col3d.metrics.functional.flicker import temporal_flicker
from col3d.reports.over_time import draw_over_time
from col3d.reports.video import VideoWriter
from col3d.runs.decorations import Decorations
from col3d.runs.provenance import provenance

COLUMNS = (
    *("name", "frame", "height", "width", "unit", "depth_min", "depth_median", "depth_max"),
    *("out_of_range", "flicker", "seconds", "fault"),
)
ALMOST_ALL = 0.99  # share of the network's largest depth from which a pixel counts as out of range
FPS = 15.0
MOST_FAULTS = 5  # skipped images that are named on screen
PENDING = 8  # frames whose files may be waiting for the disk


class PredictionFolder:
    """Context manager that writes predictions one by one.

    Args:
        path: path of the folder.
        options: options of the program, including what to write.
        network: the predictor.
        source: source of the images.
        lens: camera of the images; None if unknown.

    Raises:
        UserError: the folder holds an earlier prediction, files of others, or the input itself.
    """

    def __init__(
        self,
        path: Path,
        options: PredictOptions,
        network: Predictor,
        source: ImageSource,
        lens: Camera | None,
    ) -> None:
        self.owned = check_room(path, options, source)
        self.path, self.network, self.source, self.lens, self.options = path, network, source, lens, options
        self.unit = "relative" if lens is None else "mm"
        self.is_series = source.is_video if options.video == "auto" else options.video
        span = (options.range[0], options.range[1]) if options.range else None
        self.pictures = Pictures(span, self.unit, self.is_series)
        self.video = VideoWriter(path / VIDEO, options.fps or source.fps or FPS)
        self.files = CodeFiles(path, network.max_depth) if options.files else None
        self.clouds = Clouds(path) if options.clouds else None
        self.table: IO[str] | None = None
        self.early: list[dict[str, Any]] = []
        self.pool, self.pending = ThreadPoolExecutor(2), deque[Future[None]]()
        self.recent: deque[tuple[dict[str, Any], torch.Tensor | None]] = deque(maxlen=3)
        self.written, self.faults, self.flicker, self.seconds = 0, list[str](), list[float](), list[float]()
        self.video_fault: OSError | None = None

    def __enter__(self) -> "PredictionFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait until all files are written, and close open files."""
        self.pool.shutdown(wait=True, cancel_futures=error is not None)
        try:
            if error is None:
                self._wait(0)
                self._write_row()
        finally:
            self._close_video()
            if self.table is not None:
                with naming(self.path / TABLE):
                    self.table.close()

    def _close_video(self) -> None:
        try:
            self.video.close()
        except OSError as fault:  # raised after the summary is written
            self.video_fault = fault

    def _begin(self) -> None:
        """Remove an earlier prediction, and create folders and table; called at the first frame."""
        self.owned.remove()
        self.owned.claim(*FILES)
        kinds = {"frames": self.files, "clouds": self.clouds, "previews": self.options.previews}
        for part, is_wanted in kinds.items():
            if is_wanted:
                (self.path / part).mkdir(parents=True, exist_ok=True)
        self.table = (self.path / TABLE).open("w", encoding="utf-8", errors="backslashreplace", newline="")
        self.rows = csv.DictWriter(self.table, COLUMNS)
        with naming(self.path / TABLE):
            self.rows.writeheader()
            self.rows.writerows(self.early)

    def add(self, frame: Predicted) -> None:
        """Write a frame; the first one replaces an earlier prediction."""
        if self.table is None:
            self._begin()
        name, number = frame.shot.name, frame.shot.number
        depth = frame.counting
        row = {
            "name": name,
            "frame": number,
            **dict(zip(("height", "width"), frame.depth.shape, strict=True)),
            "unit": self.unit,
            "depth_min": f"{depth.min():.3f}",
            "depth_median": f"{np.median(depth):.3f}",
            "depth_max": f"{depth.max():.3f}",
            "out_of_range": f"{(depth >= ALMOST_ALL * self.network.max_depth).mean():.4f}",
            "seconds": f"{frame.seconds:.4f}",
        }
        page = self.pictures(frame) if self.is_series or self.options.previews else None
        if self.is_series and page is not None:
            self.video.add(page)
        with_cloud = self.clouds is not None and self.written % self.options.clouds == 0
        self.owned.claim(*self._names(frame, page is not None, with_cloud))
        self.pending.append(self.pool.submit(self._write_files, frame, page, with_cloud))
        self._wait(PENDING)
        self._add_row(row, sparse_depth(frame))
        self.written += 1
        self.seconds.append(frame.seconds)

    def _names(self, frame: Predicted, with_page: bool, with_cloud: bool) -> list[str]:
        """Return the names of the files of a frame."""
        name = frame.shot.name
        codes = ["depth"] if frame.normals is None else ["depth", "normals"]
        return [
            *(f"frames/{name}_{kind}.tiff" for kind in codes if self.files is not None),
            *([f"clouds/{name}.ply"] if with_cloud else []),
            *([f"previews/{name}.png"] if with_page and self.options.previews else []),
        ]

    def skip(self, shot: SourceImage) -> None:
        """Record an image that could not be read."""
        self.faults.append(shot.fault)
        self._add_row({"name": shot.name, "frame": shot.number, "fault": shot.fault}, None)

    def _write_files(self, frame: Predicted, page: np.ndarray | None, with_cloud: bool) -> None:
        if self.files is not None:
            self.files(frame)
        if self.clouds is not None and with_cloud:
            self.clouds(frame)
        if self.options.previews and page is not None:
            content = io.BytesIO()
            Image.fromarray(page).save(content, "PNG")
            write_whole(self.path / "previews" / f"{frame.shot.name}.png", content.getvalue())

    def _wait(self, most: int) -> None:
        """Wait until at most so many frames are being written; errors of writing are raised here."""
        while len(self.pending) > most:
            self.pending.popleft().result()

    def _add_row(self, row: dict[str, Any], depth: torch.Tensor | None) -> None:
        """Add the row of a frame; it is written after the next frame, which its flicker needs."""
        self.recent.append((row, depth))
        maps = [values for _, values in self.recent if values is not None]
        if self.is_series and len(maps) == 3 and self._follow() and len({m.shape for m in maps}) == 1:
            flicker = temporal_flicker(*maps).item()
            self.recent[1][0]["flicker"] = f"{flicker:.3f}"
            self.flicker.append(flicker)
        if len(self.recent) > 1:
            self._write_row(-2)

    def _follow(self) -> bool:
        """Whether the last three frames are consecutive."""
        first, _, last = (row["frame"] for row, _ in self.recent)
        return int(last - first) == 2

    def _write_row(self, place: int = -1) -> None:
        if not self.recent:
            return
        if self.table is None:
            self.early.append(self.recent[place][0])
        else:
            with naming(self.path / TABLE):
                self.rows.writerow(self.recent[place][0])
                self.table.flush()

    def report(self, stopped: bool) -> None:
        """Write and print the summary; do nothing if no frame was written.

        Raises:
            OSError: the summary or the video could not be written.
        """
        if not self.written:
            return
        flicker = float(np.mean(self.flicker)) if self.flicker else None
        decorations = Decorations("the rest is there; the same command makes all of it again")
        if self.is_series:
            with decorations.attempt(CHART):
                draw_over_time(self.path / TABLE, self.path / CHART)
        undone = [*decorations.undone, *([VIDEO] if self.video_fault is not None else [])]
        facts = {**self._summary(stopped, flicker), "undone": undone}
        write_json(self.path / SUMMARY, facts)  # marks the prediction as complete except for `undone`
        for fault in self.faults[:MOST_FAULTS]:
            print(f"skipped: {fault}", flush=True)
        if len(self.faults) > MOST_FAULTS:
            print(f"skipped: {len(self.faults) - MOST_FAULTS} more, see {TABLE}", flush=True)
        line = f"predicted {self.written} frames, {np.median(self.seconds):.3f} s each in the network"
        if flicker is not None:
            line += f"; depth flickers by {flicker:.2f} % from frame to frame (median over pixels)"
        print(line + ("; stopped before the end" if stopped else ""))
        made = [self.path / part for part in PARTS if (self.path / part).exists()]
        print("wrote", *map(str, made), sep="\n  ", flush=True)
        if self.video_fault is not None:
            raise self.video_fault

    def _summary(self, stopped: bool, flicker: float | None) -> dict[str, Any]:
        scale = f"{self.network.max_depth:g} {self.unit}"
        return {
            "input": self.options.input,
            "checkpoint": self.options.checkpoint,
            "model": self.network.name,
            "trained_on": list(self.network.trained_on),
            "size": list(self.network.size_hw),
            "camera": None if self.lens is None else plain_from_camera(self.lens),
            "metric": self.lens is not None,
            "unit": self.unit,
            "depth_codes": f"depth = code / 65535 * {scale}; 0 where the endoscope shows nothing",
            "normal_codes": "n = code / 65535 * 2 - 1; x right, y down, z into the scene",
            "frames": self.written,
            "skipped": len(self.faults),
            "stopped": stopped,
            "flicker_percent": flicker,
            "seconds_per_frame": float(np.median(self.seconds)) if self.seconds else None,
            "video_code": self.video.code or None,
            **provenance(),
        }
