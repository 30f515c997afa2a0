"""Write one video of a store: resized, in codes, atomically."""

import io
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from col3d.data.cache.codes import shapes
from col3d.data.cache.index import Recipe, Shard, StoredVideo, folder_of
from col3d.data.cache.sources import sources_of
from col3d.data.sized import Resized
from col3d.data.whole_folder import whole_folder


def write_video(store: Path, frames: Resized, recipe: Recipe, frame_done: Callable[[], None]) -> None:
    """Write the frames of one video.

    Args:
        store: folder of the folders of videos.
        frames: all frames of one video.
        recipe: settings that they are made by.
        frame_done: called after each frame.

    Raises:
        DataError: a file is not what it should be.
        OSError: the store cannot be written.
    """
    source = frames.frames
    video = source.frames[0].video
    sources = sources_of(source.root, source.frames)
    with whole_folder(folder_of(store, video)) as partial:
        kinds = shapes(recipe.size_hw, recipe.normals != "none")
        arrays = {
            name: ArrayFile(partial / f"{name}.npy", len(frames), *kind) for name, kind in kinds.items()
        }
        try:
            for index in range(len(frames)):
                codes = frames.encoded(index)
                for name, array in arrays.items():
                    array.append(codes[name].numpy())
                frame_done()
            shards = {name: array.finish() for name, array in arrays.items()}
        finally:
            for array in arrays.values():
                array.file.close()
        numbers = tuple(frame.number for frame in source.frames)
        release = source.releases.get(video, "")
        StoredVideo(partial, recipe.plain(), video, release, numbers, sources, shards).write()


class ArrayFile:
    """A `.npy` file that grows frame by frame: written, not mapped, so that a full disk is an error."""

    def __init__(self, path: Path, count: int, shape: tuple[int, ...], dtype: str) -> None:
        self.shape, self.dtype = (count, *shape), dtype
        header = io.BytesIO()
        npy.write_array_header_1_0(header, {"descr": dtype, "fortran_order": False, "shape": self.shape})
        self.file: BinaryIO = path.open("wb")
        self.crc32 = self.bytes = 0
        self.put(header.getvalue())
        self.offset, self.header_crc32 = self.bytes, self.crc32

    def append(self, values: np.ndarray) -> None:
        """Append the values of a frame."""
        self.put(np.ascontiguousarray(values).view(self.dtype).tobytes())

    def finish(self) -> Shard:
        """Flush the file to disk, close it, and describe it."""
        self.file.flush()
        os.fsync(self.file.fileno())
        self.file.close()
        return Shard(self.shape, self.dtype, self.offset, self.bytes, self.header_crc32, self.crc32)

    def put(self, content: bytes) -> None:
        """Append bytes, and update size and checksum."""
        self.file.write(content)
        self.bytes += len(content)
        self.crc32 = zlib.crc32(content, self.crc32)
