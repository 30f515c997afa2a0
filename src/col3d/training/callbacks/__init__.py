"""Lightning callbacks of a training, and those that are registered by name.

Callbacks that write checkpoints are in `runs`.
"""
