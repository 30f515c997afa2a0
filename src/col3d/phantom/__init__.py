"""Synthetic data: a procedural colon in the format of C3VD, for tests and trials without the real data.

A bending tube with folds, polyps and vessels is ray-cast through C3VD's own lens and written in the format of
C3VD's current release, so that everything that reads C3VD reads the phantom. It shares no pixel or mesh with
the data set; only the names of the videos, the lens and the file formats are the same.

    render_phantom(Path("phantom"), PhantomSettings(frames_per_video=8, videos=("cecum_t1_a",)))
"""

from col3d.phantom.make import phantom_is_complete, render_phantom
from col3d.phantom.settings import PARTS, PhantomSettings, phantom_camera

__all__ = ["PARTS", "PhantomSettings", "phantom_camera", "phantom_is_complete", "render_phantom"]
