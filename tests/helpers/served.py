"""The program `col3d demo`, running for a test."""

import json
import os
import socket
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from programs import command

SECONDS = 90


def until(seen: Callable[[], Any]) -> Any:
    """What `seen` returns, as soon as it is something."""
    end = time.monotonic() + SECONDS
    while not (found := seen()):
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.2)
    return found


@contextmanager
def served(checkpoint: Path | str, folder: Path, samples: str = "none") -> Iterator[str]:
    """The address of the page; its temporary files, which go with it, are in `folder`."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [*command("demo"), f"checkpoint={checkpoint}", f"port={port}"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "TMPDIR": str(folder)}
    with (folder / "log").open("w") as log:
        server = subprocess.Popen(
            [*words, f"samples={samples}"],
            cwd=folder,
            env=environment,
            stdout=log,
            stderr=subprocess.STDOUT,
        )

    def answers() -> bool:
        assert server.poll() is None, (folder / "log").read_text()
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    try:
        until(answers)
        yield f"http://127.0.0.1:{port}"
    finally:
        server.terminate()
        server.wait(SECONDS)
    assert "Traceback" not in (folder / "log").read_text()
    assert not list(folder.glob("col3d-*")), "uploads are left"


def upload(address: str, name: str, content: bytes) -> str:
    """Where the page's server put a file that a visitor of the page gave it."""
    head = f'--x\r\nContent-Disposition: form-data; name="files"; filename="{name}"\r\n\r\n'
    request = urllib.request.Request(
        f"{address}/gradio_api/upload",
        head.encode() + content + b"\r\n--x--\r\n",
        {"Content-Type": "multipart/form-data; boundary=x"},
    )
    with urllib.request.urlopen(request) as answer:
        return str(json.load(answer)[0])
