"""The command `col3d`: its programs, their options by Hydra, and refusals in one line.

The only room that knows Hydra and OmegaConf; what the programs do lives elsewhere.
"""

from col3d.cli.main import main

__all__ = ["main"]
