"""Score a checkpoint: python evaluate.py checkpoint=runs/default/checkpoints/best.ckpt split=test."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Evaluate; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.evaluate import evaluate

    evaluate(given)


if __name__ == "__main__":
    launch("evaluate", run)
