"""Management of a run's folder: lock, status, checkpoints, starts, resumption, loggers.

The training that fills it is in `training`; tables that are made of it are in `reports`.
"""
