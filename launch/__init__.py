"""Entry points: the command line and the configuration, by Hydra."""

from launch.program import composed, launch
from launch.resolvers import slug
from launch.sweeps import given_overrides, sweep_of

__all__ = ["composed", "given_overrides", "launch", "slug", "sweep_of"]
