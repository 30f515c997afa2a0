"""Signals that end a program: in its first seconds, and while work is under way that can be kept.

What is saved then is the matter of `runs` and of each program.
"""

from col3d.signals.children import children_unheard
from col3d.signals.stop import INTERRUPTED, PREEMPTED, Stopped, StopSignals, stoppable

__all__ = ["INTERRUPTED", "PREEMPTED", "StopSignals", "Stopped", "children_unheard", "stoppable"]
