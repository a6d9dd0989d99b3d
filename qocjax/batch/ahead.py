"""Work done side by side in threads, a few pieces ahead of what is taken."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Executor, Future
from itertools import islice
from queue import SimpleQueue
from typing import TypeVar

import jax
import jax.numpy as jnp

__all__ = ["side_by_side"]

P = TypeVar("P")
R = TypeVar("R")


def side_by_side(
    run: Callable[[P], R], pieces: Iterable[P], threads: Executor, ahead: int
) -> Generator[tuple[P, R], None, None]:
    """Yields each piece with what `run` makes of it, in the order in which they are finished.

    So memory does not grow with the number of pieces. What is not begun when the caller stops is left.

    Args:
        run: Called in the threads, with the float width and the default device of the calling thread.
        pieces: Taken one at a time.
        threads: Where it runs.
        ahead: Pieces under way or waiting for a thread.

    Raises:
        CancelledError, RuntimeError: The threads were shut down meanwhile, as it waits or hands out.
    """
    wide = jnp.result_type(float) == jnp.float64
    device = getattr(jax.config, "jax_default_device", None)

    def alike(piece: P) -> R:
        with jax.enable_x64(wide), jax.default_device(device):  # which other threads do not see by themselves
            return run(piece)

    source, pending = iter(pieces), dict[Future[R], P]()
    # Told of cancelled ones too, for which `concurrent.futures.wait` would wait for ever.
    finished: SimpleQueue[Future[R]] = SimpleQueue()

    def hand_out(number: int) -> None:
        for piece in islice(source, number):
            future = threads.submit(alike, piece)
            pending[future] = piece
            future.add_done_callback(finished.put)

    try:
        hand_out(ahead)
        while pending:
            future = finished.get()
            piece = pending.pop(future)
            hand_out(1)
            yield piece, future.result()
    finally:
        for future in list(pending):
            future.cancel()
