"""A network as a file for other programs: python export.py checkpoint=PATH output=model.onnx."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Export; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.export import export

    export(given)


if __name__ == "__main__":
    launch("export", run)
