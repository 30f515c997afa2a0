"""File handling: atomic writes, JSON, ownership, image formats, stored predictions, status files of runs.

Files of data sets are read in `data`; what a run does with its folder is decided in `runs`.
"""
