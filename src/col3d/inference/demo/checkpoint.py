"""The default checkpoint of the demo."""

from pathlib import Path

from col3d.inference.trained_network import SHIPPED
from col3d.io.run_files import RESULT
from col3d.runs.folder import CHECKPOINTS


def newest_checkpoint(runs: Path) -> Path:
    """Return the best checkpoint of the run that finished last, or the shipped network if there is none.

    Args:
        runs: a folder of runs and of sweeps.
    """
    marks = sorted(runs.rglob(RESULT), key=lambda path: path.stat().st_mtime, reverse=True)
    for mark in marks:
        checkpoint = mark.parent / CHECKPOINTS / "best.ckpt"
        if checkpoint.is_file():
            return checkpoint
    return Path(SHIPPED)
