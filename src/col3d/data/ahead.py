"""Prefetching: a thread makes the next items while the last ones are used."""

import queue
import threading
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

Item = TypeVar("Item")
_END = object()


def ahead(items: Iterable[Item], most: int) -> Iterator[Item]:
    """Yield the same items in the same order, up to `most` of them made before they are requested.

    An exception of the iterable is raised here, after the items before it. The thread ends when the consumer
    does.
    """
    waiting: queue.Queue[tuple[Any, BaseException | None]] = queue.Queue(most)
    left = threading.Event()

    def put(entry: tuple[Any, BaseException | None]) -> None:
        while not left.is_set():
            try:
                waiting.put(entry, timeout=0.1)
            except queue.Full:
                continue
            return

    def make() -> None:
        try:
            for item in items:
                put((item, None))
                if left.is_set():
                    return
            put((_END, None))
        except BaseException as error:  # any exception is passed on to the consumer
            put((_END, error))

    threading.Thread(target=make, daemon=True).start()
    try:
        while (entry := waiting.get())[0] is not _END:
            yield entry[0]
        if entry[1] is not None:
            raise entry[1]
    finally:
        left.set()
