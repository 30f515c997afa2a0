"""Signal handling: end a program in its first seconds, or stop it while it does work that can be kept.

What is saved on a stop is decided in `runs` and in each program.
"""

from col3d.signals.children import children_unheard
from col3d.signals.stop import INTERRUPTED, PREEMPTED, Stopped, StopSignals, stoppable

__all__ = ["INTERRUPTED", "PREEMPTED", "StopSignals", "Stopped", "children_unheard", "stoppable"]
