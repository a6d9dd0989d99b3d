"""A process beside this one, for what threads cannot share."""

from __future__ import annotations

import atexit
import gc
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any

__all__ = ["process_beside"]


@contextmanager
def process_beside(*modules: str) -> Iterator[Executor]:
    """A process that works beside this one, for command lines; started at once, so that it is ready when it is needed.

    It is spawned, since JAX's threads do not survive a fork. A program that opens it must be guarded by
    `if __name__ == "__main__"`, as with any spawned process.

    Args:
        modules: What it imports first, while this process does something else.
    """
    others = active_children()
    pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
    try:
        pool.submit(_import_all, modules)  # the first task starts the process
        own = [child for child in active_children() if child not in others]
        yield pool
    except BaseException:  # nobody waits for what it does
        for child in own:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _import_all(modules: tuple[str, ...]) -> None:
    for name in modules:
        import_module(name)


def _begin() -> None:
    """In the other process: Ctrl-C, which reaches both, is left to this one; nothing is tidied up, now or at the end.

    It ends with this one, whatever ends that: a kill leaves nobody to shut it down.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # a tenth of the time of a figure, for little memory of a process that lives shortly
    atexit.register(os._exit, 0)
    Thread(target=_follow, args=(parent_process(),), daemon=True).start()


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)
