"""Check a whole data set without training: python verify.py data=c3vd data.root=/path/to/C3VD [--fast]."""

import sys
from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Verify; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.verify import verify

    verify(given)


if __name__ == "__main__":
    sys.argv[1:] = ["fast=true" if argument == "--fast" else argument for argument in sys.argv[1:]]
    launch("verify", run)
