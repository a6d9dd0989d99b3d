"""Ctrl-C, SIGTERM and SIGHUP end a program soon, whatever it is doing, and it says how to go on.

Python's own way, an exception in the main thread, waits for threads and for what runs outside of Python (a program that
is compiled takes seconds), and is lost where it is raised inside a callback. Here it has a second; then the process
ends. Nothing is lost by that: files are put in place whole, so a kill at any moment leaves what is finished.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

__all__ = ["as_program", "goes_on", "stoppable"]

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_GRACE = 1.0  # s for what runs to put itself away
_AGAIN = "the same command starts it again"


class _Ending:
    """How this process ends."""

    def __init__(self) -> None:
        """Listens to the signals, but for those that whoever started the process has it ignore, as `nohup` does."""
        self.how: Callable[[], str] = lambda: _AGAIN
        self.number: int | None = None  # of the signal that came
        self.orderly = False  # whether an exception finds what puts things away
        self._is_putting_away = False  # since one was raised
        self._once, self._at_it = threading.Lock(), 0  # and the thread that ends it
        heard, told = socket.socketpair()  # to which the signal itself writes, whatever the main thread is doing
        told.setblocking(False)
        self._heard, self._told = heard, told
        signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
        for number in _SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._stop)
        threading.Thread(target=self._watch, daemon=True).start()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        """In the main thread, as soon as it runs Python."""
        self.number = self.number or number
        if not self.orderly:
            self.end()
            return  # to where this thread is at it
        self._is_putting_away, self.orderly = True, False  # a second signal ends it at once
        sys.unraisablehook = threading.excepthook = _ignored  # what threads and callbacks now stumble over
        raise KeyboardInterrupt

    def _watch(self) -> None:
        """In a thread of its own, at once: what compiles holds no lock of Python's."""
        while (number := self._heard.recv(1)[0]) not in _SIGNALS:
            pass
        self.number = self.number or number
        if self.orderly or self._is_putting_away:  # whichever thread is first
            self._heard.settimeout(_GRACE)
            with suppress(TimeoutError):
                self._heard.recv(1)
        self.end()

    def end(self) -> None:
        """Says how to go on, and ends; returns only where this very thread is at it already."""
        if not self._once.acquire(blocking=False):
            while self._at_it != threading.get_ident():
                time.sleep(_GRACE)
            return
        self._at_it = threading.get_ident()
        with suppress(Exception):
            _say(f"stopped: {self.how()}\n")
        os._exit(128 + (self.number or signal.SIGINT))


_ending: _Ending | None = None


def as_program(main: Callable[[], object]) -> None:
    """Runs `main` as all that this process does, so that a signal may end it: 130, 143 and 129, as shells count."""
    global _ending
    _ending = _Ending()
    try:
        main()
    except BaseException:
        if _ending.number is not None:
            _ending.end()
        raise


def goes_on(how: Callable[[], str | None]) -> None:
    """Has a stop say from now on how to go on; None for what has to begin anew."""
    if _ending is not None:
        _ending.how = lambda: how() or _AGAIN


@contextmanager
def stoppable(how: Callable[[], str | None]) -> Iterator[None]:
    """Work that puts itself away when it is stopped, by `with` and `finally`; `how` as in `goes_on`.

    Raises:
        KeyboardInterrupt: With how to go on, in a process that is more than this program.
    """
    goes_on(how)
    if _ending is None:
        try:
            yield
        except KeyboardInterrupt:
            raise KeyboardInterrupt(how() or _AGAIN) from None
        return
    try:
        _ending.orderly = True
        yield
    except BaseException:  # what a stop is taken for on its way is no error
        if _ending.number is not None:
            with suppress(Exception):
                sys.stdout.flush()
            _ending.end()
        raise
    finally:
        _ending.orderly = False


def _ignored(_: Any) -> None:
    """Takes no notice."""


def _say(text: str) -> None:
    """Writes to standard error, where that takes it at once: a pager that is full would wait."""
    if os.name != "nt" and not select.select([], [2], [], 0.2)[1]:
        return
    os.write(2, (("\n" if os.isatty(2) else "") + text).encode())
