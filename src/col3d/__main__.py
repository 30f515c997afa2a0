"""`python -m col3d PROGRAM ...`: the command, where its script is not on PATH."""

import sys

from col3d.cli import main

if __name__ == "__main__":
    sys.exit(main())
