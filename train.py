"""Train and evaluate a network: python train.py model=col3d_mtl loss.lambdas=[0.5,0.3,0.2]."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> float | tuple[float, ...]:
    """Train; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.app.train import train

    return train(given)


if __name__ == "__main__":
    launch("train", run)
