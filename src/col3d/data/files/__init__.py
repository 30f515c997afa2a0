"""Reading single files strictly: images, videos, arrays, depth. What is damaged is refused.

Which files make up a frame is in `data.datasets`.
"""
