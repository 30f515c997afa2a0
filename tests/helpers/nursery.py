"""A process that has imported everything and forks a training on demand: real processes, soon there to kill.

As a program it reads a JSON object of options from each line of its input, and answers with the process that
trains by them, then with its exit code.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any


class Nursery:
    """Starts trainings, one at a time.

    Args:
        log: where they print.
    """

    def __init__(self, log: Path) -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        self.log = log
        self.process = subprocess.Popen(
            [sys.executable, __file__, str(log)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def start(self, options: dict[str, Any]) -> int:
        """Begin a training; the process's number."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(options) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def wait(self) -> int:
        """Its exit code when it has ended, the negative signal where one killed it."""
        return self._answer()

    def close(self) -> None:
        """End it."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()

    def _answer(self) -> int:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, self.log.read_text()
        return int(line)


def _main(log: str) -> None:
    from col3d.training.train import train

    for line in sys.stdin:
        process = os.fork()
        if process == 0:
            _train_alone(train, json.loads(line), log)
        print(process, flush=True)
        _, status = os.waitpid(process, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _train_alone(train: Any, options: dict[str, Any], log: str) -> None:
    out = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.dup2(out, 1)
    os.dup2(out, 2)
    code = 1
    try:
        train(options)
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code)


if __name__ == "__main__":
    _main(sys.argv[1])
