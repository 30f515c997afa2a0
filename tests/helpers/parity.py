"""The authors' numbers, which the environment variable COL3D_PARITY leads to; see `benchmarks.reference`."""

import os

import pytest

from benchmarks.reference import network_input, published_numbers, published_shapes, published_state

__all__ = ["needs_parity", "network_input", "published_numbers", "published_shapes", "published_state"]

needs_parity = pytest.mark.skipif(
    os.environ.get("COL3D_PARITY") is None, reason="COL3D_PARITY names no folder of reference numbers"
)
