"""Command-line interface `col3d`: its programs, options composed by Hydra, and one-line error messages.

The only package that imports Hydra and OmegaConf; what the programs do is implemented elsewhere.
"""

from col3d.cli.main import main

__all__ = ["main"]
