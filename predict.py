"""Depth and normals: python predict.py checkpoint=PATH input=video.mp4 output=DIR camera=c3vd."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Predict; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.predict import predict

    predict(given)


if __name__ == "__main__":
    launch("predict", run)
