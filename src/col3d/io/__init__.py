"""File handling: atomic writes, JSON, ownership of output files, image formats, stored predictions.

Files of data sets are read in `data`, files of runs in `runs`.
"""
