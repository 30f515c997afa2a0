"""Generated code for a network, in place."""

import os
import shutil

from torch import nn

from col3d.errors import UserError

COMPILERS = ("c++", "g++", "clang++")


def compile_network(network: nn.Module, trained: bool = False) -> None:
    """Let torch generate code for a network when it is first called, for each size of a batch and each mode.

    The module stays what it is: its state dict has the same names, and `network.forward` the plain code.

    Args:
        network: on its device.
        trained: whether its weights stay as they are. They are then put into the code in the order that it
            reads them in, with batch norms multiplied in; the code serves without gradients alone.

    Raises:
        UserError: there is no C++ compiler.
    """
    wanted = (os.environ["CXX"],) if "CXX" in os.environ else COMPILERS
    if not any(shutil.which(name) for name in wanted):
        raise UserError(
            f"compile: needs a C++ compiler, and there is none ({', '.join(wanted)}); "
            "install one, as g++, or leave it false"
        )
    network.compile(dynamic=False, options={"freezing": trained})
