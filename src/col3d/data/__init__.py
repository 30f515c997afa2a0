"""Data sets decoded to house units, splits, transforms on whole items and the data module."""
