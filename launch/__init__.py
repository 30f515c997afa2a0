"""Entry points: the command line and the configuration, by Hydra."""

from pathlib import Path

from col3d import early

early.listen(Path(__file__).resolve().parents[1])  # before what takes seconds
# isort: split
from launch.program import composed, launch  # noqa: E402
from launch.resolvers import slug  # noqa: E402
from launch.sweeps import given_overrides, sweep_of  # noqa: E402

__all__ = ["composed", "given_overrides", "launch", "slug", "sweep_of"]
