"""Training of a network: options, tasks, optimisers, schedules, callbacks, and the benchmark.

The folder of a run is managed in `runs`; scoring is in `evaluation`.
"""
