"""Files in general: written whole or not at all, JSON, which files are ours, formats, predictions on disk.

Files of a data set are read in `data`, those of a run in `runs`.
"""
