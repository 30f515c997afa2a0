"""Compilation of a network by torch, in place."""

import os
import shutil

from torch import nn

from col3d.errors import UserError

COMPILERS = ("c++", "g++", "clang++")


def compile_network(network: nn.Module, trained: bool = False, cudagraphs: bool = False) -> None:
    """Compile a network when it is first called, for each size of a batch and each mode.

    The module stays the same: its state dict has the same names, and `network.forward` is the plain code.

    Args:
        network: network on its device.
        trained: whether its weights are final. They are then frozen into the code, in the layout in which it
            reads them and with batch norms folded in; the code works only without gradients.
        cudagraphs: whether a GPU is given the kernels of a pass as one graph, which takes memory of its own.

    Raises:
        UserError: there is no C++ compiler.
    """
    wanted = (os.environ["CXX"],) if "CXX" in os.environ else COMPILERS
    if not any(shutil.which(name) for name in wanted):
        raise UserError(
            f"compile: needs a C++ compiler, and there is none ({', '.join(wanted)}); "
            "install one, as g++, or leave it false"
        )
    network.compile(dynamic=False, options={"freezing": trained, "triton.cudagraphs": cudagraphs})
