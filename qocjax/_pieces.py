"""Pieces of work that are kept as a command goes, so that one that was stopped goes on.

A piece is a pure function of values, and named by all that lies in them: whoever asks for the same finds it, in any
order, and nobody finds one of something else. No state of a search has to be kept beside: given the same numbers again,
it takes the same way.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol, TypeVar

import numpy as np

from qocjax._told import UntoldError, told

__all__ = ["Arrays", "Keeper", "kept", "kept_by", "kept_each"]

Arrays = dict[str, np.ndarray]
P = TypeVar("P")


class Keeper(Protocol):
    """Where pieces are kept, by name."""

    def get(self, name: str) -> Arrays | None:
        """A piece, None where it is not there."""
        ...

    def put(self, name: str, arrays: Arrays) -> None:
        """Keeps a piece."""
        ...

    def unnamed(self, why: str) -> None:
        """Is told of work that no content names, so that nothing of it is kept."""
        ...


_keeper: ContextVar[Keeper | None] = ContextVar("keeper", default=None)  # of the thread that asks


@contextmanager
def kept_by(keeper: Keeper | None) -> Iterator[None]:
    """Keeps what is computed inside, in this thread; None keeps nothing."""
    before = _keeper.set(keeper)
    try:
        yield
    finally:
        _keeper.reset(before)


def kept(values: tuple, make: Callable[[], Arrays]) -> Arrays:
    """What `make()` gives, or gave before; what it is made of is not kept beside it.

    Args:
        values: What it is a pure function of.
        make: Computes it.
    """
    keeper, name = _named(values)
    if keeper is None or (found := keeper.get(name)) is None:
        with kept_by(None):
            found = make()
        if keeper is not None:
            keeper.put(name, found)
    return found


def kept_each(
    values: tuple, pieces: Iterable[P], compute: Callable[[Iterable[P]], Iterator[tuple[P, Arrays]]]
) -> Iterator[tuple[P, Arrays]]:
    """Yields each of some pieces with its arrays: those that are kept, then the others as they are computed.

    Args:
        values: With its number what a piece is a pure function of.
        pieces: Which there are; the same ones in the same order for the same values.
        compute: Yields the very pieces that it is given, in any order.
    """
    keeper, name = _named(values)
    if keeper is None:
        yield from compute(pieces)
        return
    missing: dict[int, tuple[str, P]] = {}  # by the identity of a piece, which need not be hashable
    for k, piece in enumerate(pieces):
        if (found := keeper.get(f"{name}-{k}")) is None:
            missing[id(piece)] = f"{name}-{k}", piece
        else:
            yield piece, found
    for piece, found in compute([piece for _, piece in missing.values()]):
        keeper.put(missing[id(piece)][0], found)
        yield piece, found


def _named(values: tuple) -> tuple[Keeper | None, str]:
    """Who keeps what follows from values, and its name."""
    keeper = _keeper.get()
    if keeper is None:
        return None, ""
    digest = hashlib.blake2b(digest_size=16)
    try:
        for part in told(values, of_run=True):
            digest.update(part)
    except UntoldError as error:
        keeper.unnamed(str(error))
        return None, ""
    return keeper, digest.hexdigest()
