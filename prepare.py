"""Make data ready for training: python prepare.py data=phantom."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Prepare; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.prepare import prepare

    prepare(given)


if __name__ == "__main__":
    launch("prepare", run)
