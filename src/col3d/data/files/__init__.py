"""Strict readers of single files: images, videos, arrays, depth. Damaged files are refused.

Which files make up a frame is in `data.datasets`.
"""
