"""Lightning callbacks: those of every training, and those that are registered by name.

Callbacks that write checkpoints are in `runs`.
"""
