"""Checks of laws that networks, losses, metrics and data sets obey, for the tests of their authors.

For example, the test of a network ::

    from col3d.testing import check_network
    from mylab.unet import UNet

    def test_unet():
        check_network(UNet)
"""

from col3d.testing.laws import check_dataset, check_loss, check_metric, check_network
from col3d.testing.scene import scene

__all__ = ["check_dataset", "check_loss", "check_metric", "check_network", "scene"]
