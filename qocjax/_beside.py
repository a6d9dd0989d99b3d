"""A process beside this one, for what threads cannot share."""

from __future__ import annotations

import gc
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from typing import Any

__all__ = ["process_beside", "without_interrupts"]


@contextmanager
def process_beside(*modules: str) -> Iterator[Executor]:
    """A process that works beside this one, for command lines; started at once, so that it is ready when it is needed.

    It is spawned, since JAX's threads do not survive a fork. A program that opens it must be guarded by
    `if __name__ == "__main__"`, as with any spawned process. In the end it is killed, whatever it is doing: what was
    wanted of it has been waited for. It ends with this process too, whatever ends that.

    Args:
        modules: What it imports first, while this process does something else.
    """
    pool = _Beside()
    try:
        pool.submit(_import_all, modules)
        yield pool
    finally:
        pool.shutdown()


class _Beside(Executor):
    """One process and a pipe to it.

    A `ProcessPoolExecutor` cannot be ended before its work is, and has semaphores, which a kill of this process leaves
    for the system to warn of.
    """

    def __init__(self) -> None:
        context = get_context("spawn")
        self._pipe, there = context.Pipe()
        self._tasks: SimpleQueue[tuple[Future, Callable[[], Any]] | None] = SimpleQueue()
        self._process = context.Process(target=_serve, args=(there,), daemon=True)
        with without_interrupts():
            self._process.start()
        there.close()
        Thread(target=self._hand_over, daemon=True).start()

    def submit(self, fn: Callable, /, *args: Any, **options: Any) -> Future:
        """Has a function of a module called there; of a process that died comes a `BrokenExecutor`."""
        future: Future = Future()
        self._tasks.put((future, partial(fn, *args, **options)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kills the process; whoever waits for it finds it broken."""
        self._tasks.put(None)
        self._process.kill()
        self._process.join()

    def _hand_over(self) -> None:
        while (task := self._tasks.get()) is not None:
            future, call = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                self._pipe.send(call)
                error, result = self._pipe.recv()
            except (EOFError, OSError):
                error, result = BrokenExecutor("the process beside this one has ended"), None
            except Exception as found:  # what cannot be sent
                error, result = found, None
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Ctrl-C reaches all processes of a terminal: leaves it to this one, since what is started here inherits this."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    _start_tracker()  # which, started later, would undo it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_tracker() -> None:
    """Starts Python's own process that clears away the semaphores of one that was killed; it need not warn of them."""
    before = os.environ.get("PYTHONWARNINGS")
    quiet = "ignore:resource_tracker:UserWarning"
    os.environ["PYTHONWARNINGS"] = f"{before},{quiet}" if before else quiet
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _import_all(modules: tuple[str, ...]) -> None:
    for name in modules:
        import_module(name)


def _serve(pipe: Connection) -> None:
    """In the other process: does what comes, until nobody is left to send it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # a tenth of the time of a figure, for little memory of a process that lives shortly
    Thread(target=_follow, args=(parent_process(),), daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            data = pipe.recv_bytes()
            answer: tuple[Exception | None, Any]
            try:
                answer = None, pickle.loads(data)()
            except Exception as error:
                answer = error, None
            pipe.send(answer)


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)
