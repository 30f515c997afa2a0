"""Fusion of frames with poses into one surface, and comparison of surfaces.

Poses are camera-to-world matrices, (4, 4) on column vectors, in mm. Needs `pip install 'col3d[fusion]'`.
"""

from col3d.inference.fusion.compare import Comparison, compare
from col3d.inference.fusion.surface import Surface
from col3d.inference.fusion.volume import Volume

__all__ = ["Comparison", "Surface", "Volume", "compare"]
