"""How a job calls itself again: Lightning starts further processes by the command line it finds."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import read_write

from col3d.cli.paths import quoted_again

PROCESSES = ("LOCAL_RANK", "NODE_RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""What Lightning tells its other processes, and its own next Trainer."""
POLL_SECONDS = 1.0


class Again:
    """The command of a program, as another process is to be started by.

    Args:
        argv: of this process, before anything of it was changed.
        name: of the program; the word after the command, where argv[0] is not the program's own script.
    """

    def __init__(self, argv: Sequence[str], name: str) -> None:
        script = Path(argv[0]).absolute()
        self.command = [str(script), *([] if script.name == f"{name}.py" else [name])]

    @contextmanager
    def by_itself(self) -> Iterator[None]:
        """Within this, a job looks as if it were called alone, whether it is one of a sweep or not."""
        hydra = HydraConfig.get()
        if str(hydra.launcher._target_).endswith(".JoblibLauncher"):
            threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
        arguments, folder = sys.argv, hydra.runtime.output_dir
        before = {name: os.environ.get(name) for name in PROCESSES}
        given = arguments[1:]
        if hydra.mode == RunMode.MULTIRUN:
            given = [*quoted_again(hydra.overrides.task), "hydra.mode=RUN", f"hydra.run.dir={folder}"]
            with read_write(hydra.run):  # type: ignore[arg-type]
                hydra.run.dir = folder
        sys.argv = [*self.command, *given]
        try:
            yield
        finally:
            sys.argv = arguments
            for name, value in before.items():
                os.environ.pop(name, None)
                if value is not None:
                    os.environ[name] = value


def _end_with(launcher: int) -> None:
    """Ask a job to save and leave when the process that launched it is gone: joblib's workers outlive it."""
    while os.getppid() == launcher:
        time.sleep(POLL_SECONDS)
    os.kill(os.getpid(), signal.SIGTERM)
