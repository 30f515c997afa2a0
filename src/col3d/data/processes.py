"""Run jobs in several processes, with a progress bar that counts frames."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

import cv2
import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from col3d.errors import UserError

POLL_SECONDS = 0.2

_frames_done: Any = None
"""The counter that a worker process shares with its parent."""


def in_processes(
    work: Callable[..., Any],
    jobs: Sequence[Sequence[Any]],
    label: str,
    frames: int,
    workers: int | None = None,
    progress: bool = True,
) -> list[Any]:
    """Call `work(*job, frame_done)` for every job, several at a time, with a progress bar.

    Args:
        work: a function of a module; it calls `frame_done()` after each frame.
        jobs: the other arguments of each call.
        label: text at the left of the bar.
        frames: number of frames of all jobs together.
        workers: number of processes, as many as cores when absent. More than one needs a main module that can
            be imported, as multiprocessing's `spawn` does.
        progress: whether to show the bar.

    Returns:
        The result of each job, in their order.

    Raises:
        Exception: the first that a job raises; jobs that have not begun are cancelled.
    """
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    with frames_bar(label, shown=progress and bool(jobs)) as bar:
        task = bar.add_task("frames", total=frames)
        if workers > 1:
            return _in_pool(label, work, jobs, workers, lambda done: bar.update(task, completed=done))
        return [work(*job, lambda: bar.advance(task)) for job in jobs]


def frames_bar(label: str, shown: bool = True) -> Progress:
    """A progress bar that counts frames and shows the time left."""
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
    """Run jobs in a pool of spawned processes: forking a process that has used threads may hang."""
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
    """Set the start method to `spawn` inside the block where it is joblib's own.

    Children are given the start method by name, and look it up before they import joblib.
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
    """Start processes in a thread, where no signal's exception can leave one half started.

    Ctrl-C never reaches these processes: their parent ends them.
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
        signal.signal(number, lambda *_: sys.exit(1))  # so that they delete unfinished files
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End a worker whose parent was killed; it would wait for its next job for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)


def _counted(work: Callable[..., Any], job: Sequence[Any]) -> Any:
    try:
        return work(*job, _count)
    except SystemExit:  # the pool would take it for a result of the job
        os._exit(1)


def _count() -> None:
    with _frames_done.get_lock():
        _frames_done.value += 1
