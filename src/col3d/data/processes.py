"""Work on several videos at a time, with progress, and folders that are there whole or not at all."""

import json
import multiprocessing
import os
import re
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from col3d.errors import DataError, UserError, naming

POLL_SECONDS = 0.2
PARTIAL = ".partial-"
LISTS = {
    "phantom.json": r"\d{4,}_(color|occlusion|depth|normals|flow)\.(png|tiff)|pose\.txt|coverage_mesh\.obj",
    "index.json": r"(image|depth|normals|mask)\.npy",
}
"""Files that list what a rendered or a prepared video consists of, and the names of what is ours where a list
cannot be read."""

_frames_done: Any = None
"""In a worker process: the counter it shares with its parent."""


def in_processes(
    work: Callable[..., Any],
    jobs: Sequence[Sequence[Any]],
    label: str,
    frames: int,
    workers: int | None = None,
    progress: bool = True,
) -> list[Any]:
    """Call `work(*job, frame_done)` for every job, several at a time, under a bar with the time left.

    Args:
        work: a function of a module; it calls `frame_done()` after each frame.
        jobs: its other arguments.
        label: what the bar is of.
        frames: of all jobs together.
        workers: processes, as many as cores when absent. More than one needs a main module that can be
            imported, as multiprocessing's `spawn` does.
        progress: show the bar.

    Returns:
        What it returned for each job, in their order.

    Raises:
        Exception: the first that a job raises; jobs that have not begun are given up.
    """
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    with frames_bar(label, shown=progress and bool(jobs)) as bar:
        task = bar.add_task("frames", total=frames)
        if workers > 1:
            return _in_pool(label, work, jobs, workers, lambda done: bar.update(task, completed=done))
        return [work(*job, lambda: bar.advance(task)) for job in jobs]


def frames_bar(label: str, shown: bool = True) -> Progress:
    """A bar that counts frames and says how long the rest takes."""
    columns = (
        TextColumn(label),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("frames,"),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    return Progress(*columns, disable=not shown)


def _in_pool(
    label: str,
    work: Callable[..., Any],
    jobs: Sequence[Sequence[Any]],
    workers: int,
    report: Callable[[int], None],
) -> list[Any]:
    """Spawned, not forked: forking a process that has used threads may hang."""
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    with ProcessPoolExecutor(workers, context, initializer=_start, initargs=(counter,)) as pool:
        try:
            with _usual_start_method():
                futures: list[Future[Any]] = _undisturbed(
                    lambda: [pool.submit(_counted, work, job) for job in jobs]
                )
            waiting = set(futures)
            while waiting:
                done, waiting = wait(waiting, POLL_SECONDS, FIRST_EXCEPTION)
                report(counter.value)
                for future in done:
                    future.result()
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()
            if isinstance(error, BrokenProcessPool):
                raise UserError(
                    f"{label}: the system ended a worker, which is what it does when memory is out; give "
                    "fewer of them with workers=..., and the same command goes on"
                ) from None
            raise
        return [future.result() for future in futures]


@contextmanager
def _usual_start_method() -> Iterator[None]:
    """Let processes be started where this one is of joblib, whose way of starting is told to them by name.

    They would look for that name before they know joblib.
    """
    before = multiprocessing.get_start_method(allow_none=True)
    if before in (None, *multiprocessing.get_all_start_methods()):
        yield
        return
    multiprocessing.set_start_method("spawn", force=True)
    try:
        yield
    finally:
        multiprocessing.set_start_method(before, force=True)


def _undisturbed(start: Callable[[], Any]) -> Any:
    """Start processes in a thread, where no signal's exception leaves one half started.

    Ctrl-C never reaches what is started there: its parent ends it.
    """
    with ThreadPoolExecutor(
        1, initializer=signal.pthread_sigmask, initargs=(signal.SIG_BLOCK, {signal.SIGINT})
    ) as thread:
        return thread.submit(start).result()


def _start(counter: Any) -> None:
    global _frames_done  # noqa: PLW0603 - a pool hands its workers shared values at their start alone
    _frames_done = counter
    cv2.setNumThreads(0)  # there are as many processes as cores; threads of each would wait on the others
    torch.set_num_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent, which ends its workers
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(1))  # so that they clear away what is half done
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for its next job for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)


def _counted(work: Callable[..., Any], job: Sequence[Any]) -> Any:
    try:
        return work(*job, _count)
    except SystemExit:  # which the pool would take for a result of the job
        os._exit(1)


def _count() -> None:
    with _frames_done.get_lock():
        _frames_done.value += 1


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A folder to fill that takes the place of `folder` when the block ends well, and vanishes otherwise.

    Raises:
        DataError: `folder` holds something that this program did not write; the block does not begin.
    """
    check_replaceable(folder)
    partial = folder.parent / f"{PARTIAL}{folder.name}-{os.getpid()}"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        with naming(folder):
            yield partial
        _remove(folder)
        partial.replace(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_replaceable(folder: Path) -> None:
    """Refuse a video's folder with anything in it that this program did not write.

    Raises:
        DataError: names the folder and what is in it.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise DataError(f"{folder} is no folder of this program and stays as it is; move it away")
    if folder.is_dir() and (others := sorted(_names(folder) - set(_written(folder)))):
        raise DataError(
            f"{folder} holds {others[0]}, which this program did not write and which stays as it is; move it "
            "elsewhere, and the same command makes the video anew"
        )


def _written(folder: Path) -> list[str]:
    """Names of the files of a video that this program wrote, their list last: it goes when they are gone."""
    for name, pattern in LISTS.items():
        if (folder / name).is_file():
            listed = _listed(folder / name)
            if listed is None:
                listed = {file for file in _names(folder) if re.fullmatch(pattern, file)}
            return [*sorted(listed & _names(folder)), name]
    return []


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def _listed(path: Path) -> set[str] | None:
    """The files that a list names; None where it is cut off or damaged."""
    with suppress(OSError, ValueError, AttributeError, TypeError):
        content = json.loads(path.read_text(encoding="utf-8"))
        files = content["files"] if "files" in content else [f"{name}.npy" for name in content["shards"]]
        return {str(name) for name in files}
    return None


def _remove(folder: Path) -> None:
    """Delete what is to be replaced; what others put there since is in the way, and stays."""
    check_replaceable(folder)
    if folder.is_dir():
        for name in _written(folder):
            (folder / name).unlink()
        folder.rmdir()


def remove_stale(root: Path) -> None:
    """Delete what interrupted processes left behind; folders of running ones and of others stay."""
    names = re.compile("|".join([*LISTS.values(), *map(re.escape, LISTS)]))
    for folder in root.glob(f"{PARTIAL}*-*"):
        process = folder.name.rpartition("-")[2]
        if not process.isdigit() or _is_running(int(process)) or folder.is_symlink() or not folder.is_dir():
            continue
        if all(names.fullmatch(name) for name in _names(folder)):
            shutil.rmtree(folder, ignore_errors=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
