"""Rendering what a phantom lacks, several videos at a time."""

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

import cv2
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from col3d.data.phantom.settings import PhantomSettings
from col3d.data.phantom.write import check_root, remove_stale, render_video, video_is_complete

POLL_SECONDS = 0.2

_frames_done: Any = None
"""In a worker process: the counter it shares with its parent."""


def phantom_is_complete(root: Path, settings: PhantomSettings) -> bool:
    """Whether `root` holds every video of these settings with every file at its full size."""
    return not _missing(root, settings)


def render_phantom(
    root: Path, settings: PhantomSettings, workers: int | None = None, progress: bool = True
) -> None:
    """Render the videos that `root` lacks; a partly rendered video is done anew, never trusted.

    Args:
        root: folder of the folders of videos; made where it does not exist.
        settings: the phantom; videos of the same settings that are already complete stay.
        workers: processes, as many as cores when absent; the files do not depend on it. More than one needs
            a main module that can be imported, as multiprocessing's `spawn` does.
        progress: show a bar with the frames done and the time left.

    Raises:
        DataError: `root` holds other data or videos of other settings.
    """
    check_root(root, settings)
    root.mkdir(parents=True, exist_ok=True)
    remove_stale(root)
    videos = _missing(root, settings)
    workers = min(workers or os.cpu_count() or 1, len(videos))
    columns = (
        TextColumn("phantom"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("frames,"),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    with Progress(*columns, disable=not progress or not videos) as bar:
        task = bar.add_task("frames", total=len(videos) * settings.frames_per_video)
        if workers > 1:
            _in_processes(root, videos, settings, workers, lambda done: bar.update(task, completed=done))
        else:
            for video in videos:
                render_video(root, video, settings, lambda: bar.advance(task))


def _missing(root: Path, settings: PhantomSettings) -> list[str]:
    return [video for video in settings.videos if not video_is_complete(root / video, settings)]


def _in_processes(
    root: Path, videos: list[str], settings: PhantomSettings, workers: int, report: Callable[[int], None]
) -> None:
    """Spawned, not forked: forking a process that has used threads may hang."""
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    with ProcessPoolExecutor(workers, context, initializer=_start, initargs=(counter,)) as pool:
        waiting: set[Future[None]] = {pool.submit(_render_counted, root, v, settings) for v in videos}
        while waiting:
            done, waiting = wait(waiting, POLL_SECONDS, FIRST_EXCEPTION)
            report(counter.value)
            for future in done:
                if future.exception():
                    pool.shutdown(wait=False, cancel_futures=True)
                future.result()


def _start(counter: Any) -> None:
    global _frames_done  # noqa: PLW0603 - a pool hands its workers shared values at their start alone
    _frames_done = counter
    cv2.setNumThreads(1)


def _render_counted(root: Path, video: str, settings: PhantomSettings) -> None:
    render_video(root, video, settings, _count)


def _count() -> None:
    with _frames_done.get_lock():
        _frames_done.value += 1
