"""The folder of a run: lock, status, checkpoints, what it was started with, how it goes on, its loggers.

What fills it is in `training`; what reads it for tables, in `reports`.
"""
