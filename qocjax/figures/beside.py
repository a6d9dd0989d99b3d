"""Drawing figures on two cores: a process beside this one takes half of them."""

from __future__ import annotations

import atexit
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

from matplotlib.figure import Figure

from qocjax.figures.save import save

__all__ = ["Drawing", "draw_all", "process_beside"]

# What makes the figure, picklable, and where it goes (path without suffix).
Drawing = tuple[Callable[[], Figure], Path]


@contextmanager
def process_beside() -> Iterator[Executor]:
    """A process that draws, started at once so that it is ready when the results are; for command lines.

    It is spawned, since JAX's threads do not survive a fork. A program that opens it must be guarded by
    `if __name__ == "__main__"`, as with any spawned process.
    """
    pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
    try:
        pool.submit(int)  # nothing; the first task starts the process
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def draw_all(drawings: Sequence[Drawing], pool: Executor | None = None) -> list[Path]:
    """Makes and saves figures: the pool from the first on, this process from the last, until they meet.

    Args:
        drawings: What to draw.
        pool: From `process_beside`; None draws all here. A pool that breaks costs time, no figure.

    Returns:
        The files in the order of the drawings, a PNG and a PDF of each.
    """
    sent: list[Future | None] = [pool.submit(_draw, each) if pool else None for each in drawings]
    done: dict[int, list[Path]] = {}
    for k in reversed(range(len(drawings))):
        future = sent[k]
        if future is None or future.cancel():
            done[k] = _draw(drawings[k])
    for k, future in enumerate(sent):
        if k not in done and future is not None:
            try:
                done[k] = future.result()
            except BrokenExecutor:
                done[k] = _draw(drawings[k])
    return [path for k in range(len(drawings)) for path in done[k]]


def _draw(drawing: Drawing) -> list[Path]:
    make, stem = drawing
    return save(make(), stem)


def _begin() -> None:
    """In the other process: Ctrl-C, which reaches both, is left to this one; nothing is tidied up at the end.

    It ends with this one, whatever ends that: a kill leaves nobody to shut it down.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    atexit.register(os._exit, 0)
    Thread(target=_follow, args=(parent_process(),), daemon=True).start()


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)
