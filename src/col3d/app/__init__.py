"""From a plain dictionary of options to a finished run: check it, build it, run it."""
