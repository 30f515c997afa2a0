"""Stored predictions: one compressed file for each video, with depth and normals in 16 bits.

`<video>.npz` holds for frame n the arrays `<n>_depth` (uint16; 65535 is `max_depth` of `index.json`) and,
where the network predicts them, `<n>_normals` (int16 (h, w, 3); 32767 is 1). Depth of up to 100 mm is exact
to 0.001 mm, normals to 0.003 degrees.

The ground truth of a part of a split is stored in the same way, with the images (`<n>_image`, uint8) and, if
there are any, occlusions (`<n>_occlusion`, bool). In it, depth 0 and normal (0, 0, 0) mean unknown, and
`index.json` has `off_axis`, the angle in degrees between each pixel's ray and the optical axis.
"""

import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile

from col3d.errors import DataError, UserError
from col3d.io.atomic import write_whole
from col3d.io.ownership import Owned

DEPTH_STEPS, NORMAL_STEPS = 65535, 32767
INDEX = "index.json"


class PredictionWriter:
    """Writes the predictions of frames in the order of their videos.

    Args:
        folder: where the files go; predictions that are stored there are replaced, and nothing else.
        facts: the content of `index.json`: `max_depth` in mm, among others.
    """

    def __init__(self, folder: Path, facts: Mapping[str, Any]) -> None:
        self.folder, self.facts = folder, dict(facts)
        self.video: str | None = None
        self.archive: zipfile.ZipFile | None = None
        self.owned = owned_predictions(folder)
        self.owned.check_place()
        folder.mkdir(parents=True, exist_ok=True)
        self.owned.remove()

    def add(
        self,
        video: str,
        frame: int,
        depth: np.ndarray,
        normals: np.ndarray | None,
        image: np.ndarray | None = None,
        occlusion: np.ndarray | None = None,
    ) -> None:
        """Append a frame.

        Args:
            video: name of the video.
            frame: number of the frame in its video.
            depth: (h, w) in mm.
            normals: (h, w, 3), of unit length.
            image: (h, w, 3) in [0, 1], stored with the ground truth.
            occlusion: (h, w), stored with the ground truth: True where another surface lies behind the
                visible one.

        Raises:
            UserError: a number is not finite, or a file of others is in the way.
        """
        for name, values in (("depth", depth), ("normals", normals)):
            if values is not None and not np.isfinite(values).all():
                raise UserError(
                    f"{name} of {video}, frame {frame}, is not finite: the network's weights are damaged, or "
                    "of a training that diverged"
                )
        if video != self.video:
            self._close()
            self.video = video
            self.owned.claim(f"{video}.npz")
            partial = self.folder / f"{video}.npz.partial"
            partial.parent.mkdir(parents=True, exist_ok=True)  # names of videos may contain folders
            self.archive = zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
        codes = np.round(depth.clip(0, self.facts["max_depth"]) / self.facts["max_depth"] * DEPTH_STEPS)
        self._put(f"{frame}_depth", codes.astype(np.uint16))
        if normals is not None:
            self._put(f"{frame}_normals", np.round(normals * NORMAL_STEPS).astype(np.int16))
        if image is not None:
            self._put(f"{frame}_image", np.round(image * 255).astype(np.uint8))
        if occlusion is not None:
            self._put(f"{frame}_occlusion", occlusion.astype(np.bool_))

    def finish(self) -> None:
        """Close the last video and write `index.json`, which marks the predictions as complete."""
        self._close()
        self.owned.claim(INDEX)
        write_whole(self.folder / INDEX, json.dumps(self.facts, indent=2) + "\n")

    def give_up(self) -> None:
        """Remove the partial file of the current video, after an error or a stop."""
        if self.archive is not None:
            with suppress(OSError, ValueError):  # a full disk, or an entry that is still open
                self.archive.close()
            (self.folder / f"{self.video}.npz.partial").unlink(missing_ok=True)
            self.archive = None

    def _put(self, name: str, values: np.ndarray) -> None:
        assert self.archive is not None
        with self.archive.open(f"{name}.npy", "w") as file:
            np.lib.format.write_array(file, values, allow_pickle=False)

    def _close(self) -> None:
        if self.archive is not None:
            self.archive.close()
            (self.folder / f"{self.video}.npz.partial").replace(self.folder / f"{self.video}.npz")
            self.archive = None


def owned_predictions(folder: Path) -> Owned:
    """Return the predictions in a folder that this program wrote; some have no list and are added to one."""
    owned = Owned(folder, "predictions", "predictions")
    if not owned.names and {"max_depth", "split"} <= (read_facts(folder) or {}).keys():
        videos = dict.fromkeys(video for video, _ in StoredPredictions(folder).frames())
        owned.adopt(INDEX, *(f"{video}.npz" for video in videos))
    return owned


class StoredPredictions:
    """Reads what `PredictionWriter` wrote.

    Raises:
        DataError: the folder holds no finished predictions, or a file of it cannot be read.
        FileNotFoundError: there is no such video.
        KeyError: there is no such frame.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            self.facts: dict[str, Any] = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise DataError(f"{folder} holds no finished predictions: {INDEX} is missing or broken") from None

    @contextmanager
    def _opened(self, video: str) -> Iterator[NpzFile]:
        path = self.folder / f"{video}.npz"
        try:
            with np.load(path, allow_pickle=False) as stored:
                yield stored
        except FileNotFoundError:
            raise
        except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise DataError(f"{path}: predictions cannot be read ({reason}); make them again") from None

    def read(self, video: str, frame: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Read depth (h, w) in mm and normals (h, w, 3), or None if there are none; both float32."""
        with self._opened(video) as stored:
            depth = stored[f"{frame}_depth"].astype(np.float32) / DEPTH_STEPS * self.facts["max_depth"]
            name = f"{frame}_normals"
            normals = stored[name].astype(np.float32) / NORMAL_STEPS if name in stored.files else None
        return depth, normals

    def read_image(self, video: str, frame: int) -> np.ndarray:
        """Read the RGB image (h, w, 3) in [0, 1] of a frame whose image is stored."""
        with self._opened(video) as stored:
            image: np.ndarray = stored[f"{frame}_image"].astype(np.float32) / 255
        return image

    def read_occlusion(self, video: str, frame: int) -> np.ndarray | None:
        """Read the mask (h, w) of pixels with another surface behind the visible one; None if not stored."""
        with self._opened(video) as stored:
            name = f"{frame}_occlusion"
            return stored[name] if name in stored.files else None

    def frames(self) -> list[tuple[str, int]]:
        """List the stored frames as pairs (video, frame number)."""
        frames = []
        for path in sorted(self.folder.rglob("*.npz")):
            video = path.relative_to(self.folder).with_suffix("").as_posix()
            with self._opened(video) as stored:
                numbers = [
                    int(name.removesuffix("_depth")) for name in stored.files if name.endswith("_depth")
                ]
            frames += [(video, number) for number in sorted(numbers)]
        return frames


def read_facts(folder: Path) -> dict[str, Any] | None:
    """Read `index.json` of finished predictions; None if the folder holds none."""
    try:
        return StoredPredictions(folder).facts
    except ValueError:
        return None
