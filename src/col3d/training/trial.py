"""A training of a few batches in a folder that is thrown away: does everything run?"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from col3d.runs.rank import is_first
from col3d.training.options import TrainOptions

FOLDER = "COL3D_FAST_DEV_RUN"
"""By which the processes of one training know where they try."""

WENT_THROUGH = "batch(es) of training, validation and test went through; nothing is kept"


@contextmanager
def trial(options: TrainOptions) -> Iterator[TrainOptions]:
    """The same training with a few batches of everything, without loggers and in a folder of its own.

    Nothing is written into the folder of the run, so that nothing there can pass for one.
    """
    inherited = os.environ.get(FOLDER)
    place = Path(inherited or tempfile.mkdtemp(prefix="col3d_"))
    os.environ[FOLDER] = str(place)
    changes = {"output_dir": str(place / "run"), "trainer": options.trainer.tried(), "logger": {}}
    try:
        yield options.model_copy(update={**changes, "overwrite": False})
        if is_first():
            print(f"fast_dev_run: {int(options.trainer.fast_dev_run or 1)} {WENT_THROUGH}", flush=True)
    finally:
        os.environ.pop(FOLDER, None)
        if inherited is None:
            shutil.rmtree(place, ignore_errors=True)
        with suppress(OSError):  # it holds something, or is not there
            Path(options.output_dir).rmdir()
