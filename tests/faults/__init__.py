"""What becomes of a training that something goes wrong with: `python -m tests.faults`.

Each fault is made for `train.py` in a process of its own, when an event is seen: a line that it prints, or a
file that appears. Then the same command runs again, and what it ends in is held against an undisturbed run.
"""
