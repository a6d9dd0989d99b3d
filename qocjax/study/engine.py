"""The engine that needs nothing: chunks in this process."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor

import jax

from qocjax._xla import num_workers
from qocjax.batch.ahead import side_by_side
from qocjax.study.chunks import Chunk, Failure, Result, compute
from qocjax.study.problem import Problem

__all__ = ["LocalEngine", "failure_of"]

# Chunks under way at once: while the last batches of one finish, those of the next keep the cores busy.
_UNDER_WAY = 2


class LocalEngine:
    """Computes chunks here, on all cores or on the accelerator."""

    def run(self, problem: Problem, chunks: Sequence[Chunk]) -> Generator[tuple[Chunk, Result | Failure], None, None]:
        """Yields each chunk when it is finished.

        Raises:
            ValueError: What `evaluate` raises.
        """
        workers, ahead = ThreadPoolExecutor(num_workers()), ThreadPoolExecutor(_UNDER_WAY)

        def one(chunk: Chunk) -> Result | Failure:
            try:
                return compute(problem, chunk, workers)
            except (MemoryError, jax.errors.JaxRuntimeError) as error:
                return failure_of(error)

        try:
            yield from side_by_side(one, chunks, ahead, _UNDER_WAY)
        finally:
            workers.shutdown(wait=False, cancel_futures=True)
            ahead.shutdown(wait=False, cancel_futures=True)


def failure_of(error: BaseException) -> Failure:
    """An error as the cause of a failure, in one line."""
    text = " ".join(str(error).split())
    return Failure(f"{type(error).__name__}: {text[:300]}" if text else type(error).__name__)
