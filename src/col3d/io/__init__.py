"""File handling: atomic writes, JSON, ownership of output files, image formats, stored predictions.

Files of a data set are read in `data`, those of a run in `runs`.
"""
