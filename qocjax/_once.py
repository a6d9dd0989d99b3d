"""Values made once and shared by threads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import Generic, TypeVar

__all__ = ["Once"]

T = TypeVar("T")


class Once(Generic[T]):
    """Values by key; threads that ask for the same one wait for the first to make it."""

    def __init__(self, capacity: int | None = None) -> None:
        """Keeps the `capacity` values made last, or all."""
        self._values: dict[Hashable, Future[T]] = {}
        self._capacity = capacity
        self._lock = threading.Lock()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value of a key, from `make()` if it is not there; an error of `make` is not kept."""
        with self._lock:
            mine = key not in self._values
            future = self._values.setdefault(key, Future())
            if mine and self._capacity is not None and len(self._values) > self._capacity:
                del self._values[next(iter(self._values))]
        if mine:
            try:
                future.set_result(make())
            except BaseException as error:
                with self._lock:
                    self._values.pop(key, None)
                future.set_exception(error)
        return future.result()
