"""Train and evaluate a network: python train.py model=col3d_mtl loss.lambdas=[0.5,0.3,0.2].

The same program as `col3d train`, from a checkout.
"""

import sys

from col3d.cli import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]]))
