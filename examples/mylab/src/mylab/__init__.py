"""Parts of mylab: whatever is imported here is known to col3d."""

from mylab import tinynet

__all__ = ["tinynet"]
