"""Data sets as frames, batches and splits: reading, preparation, augmentation and checks.

How a single file is decoded is in `data.files`; a colon that is rendered, in `phantom`.
"""

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.c3vdv2 import C3VDv2
from col3d.data.datasets.folder import FolderFrames
from col3d.data.datasets.frame_files import Kind
from col3d.data.datasets.frame_set import Depth, FrameSet
from col3d.data.datasets.simcol3d import SimCol3D

__all__ = ["C3VD", "C3VDv2", "Depth", "FolderFrames", "FrameSet", "Kind", "SimCol3D"]
