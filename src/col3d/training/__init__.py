"""One training from its options to its result: tasks, optimisers, schedules, callbacks, the benchmark.

The folder that a training writes is in `runs`; how it is scored, in `evaluation`.
"""
