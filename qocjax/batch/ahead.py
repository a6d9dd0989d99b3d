"""Work done side by side in threads, a few pieces ahead of what is taken."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from itertools import islice
from typing import TypeVar

import jax
import jax.numpy as jnp

__all__ = ["side_by_side"]

_LOOK = 0.5  # s between looks whether the threads were shut down

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
        CancelledError: The threads were shut down meanwhile.
    """
    wide = jnp.result_type(float) == jnp.float64
    device = getattr(jax.config, "jax_default_device", None)

    def alike(piece: P) -> R:
        with jax.enable_x64(wide), jax.default_device(device):  # which other threads do not see by themselves
            return run(piece)

    source = iter(pieces)
    pending: dict[Future[R], P] = {threads.submit(alike, piece): piece for piece in islice(source, ahead)}
    try:
        while pending:
            done, rest = wait(pending, timeout=_LOOK, return_when=FIRST_COMPLETED)
            if not done and any(future.cancelled() for future in rest):  # the threads end: nobody tells who waits
                raise CancelledError
            for future in done:
                piece = pending.pop(future)
                for following in islice(source, 1):
                    pending[threads.submit(alike, following)] = following
                yield piece, future.result()
    finally:
        for future in pending:
            future.cancel()
