"""Videos from where they are published: python download.py data=c3vd data.root=/path/to/C3VD."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Download; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.download import download

    download(given)


if __name__ == "__main__":
    launch("download", run)
