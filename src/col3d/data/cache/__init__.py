"""A data set prepared at one size: for each video four arrays in codes and an index, read by memory map.

    <store>/<video>/image.npy    (n, 3, h, w) uint8
                    depth.npy    (n, h, w) uint16
                    normals.npy  (n, 2, h, w) int16, where there are normals
                    mask.npy     (n, h, w) bool
                    index.json   its sources and recipe; written last

`col3d.data.cache.codes` defines the codes. A video's folder is written atomically.
"""

from col3d.data.cache.index import Recipe, StoredVideo, folder_of, read_video, videos_in
from col3d.data.cache.read import Stored
from col3d.data.cache.write import write_video

__all__ = ["Recipe", "Stored", "StoredVideo", "folder_of", "read_video", "videos_in", "write_video"]
