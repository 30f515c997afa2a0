"""Laws that parts of an experiment obey, for the tests of whoever writes one.

A network is held to them by ::

    from col3d.testing import check_network
    from mylab.unet import UNet

    def test_unet():
        check_network(UNet)
"""

from col3d.testing.laws import check_dataset, check_loss, check_metric, check_network
from col3d.testing.scene import scene

__all__ = ["check_dataset", "check_loss", "check_metric", "check_network", "scene"]
