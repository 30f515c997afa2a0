"""One surface of a video: python fuse.py video=/path/to/C3VD/cecum_t1_a checkpoint=PATH output=DIR."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Fuse; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.fuse import fuse

    fuse(given)


if __name__ == "__main__":
    launch("fuse", run)
