"""col3d's laws of networks."""

from mylab.tinynet import TinyNet

from col3d.testing import check_network


def test_tinynet() -> None:
    """Sizes, batches, gradients, and what a file keeps."""
    check_network(TinyNet)
