"""The engine that needs nothing: chunks in this process."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice

import jax
import jax.numpy as jnp

from qocjax.batch.xla import num_workers
from qocjax.study.chunks import Chunk, Failure, Problem, Result, compute

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
        wide = jnp.result_type(float) == jnp.float64
        workers, ahead = ThreadPoolExecutor(num_workers()), ThreadPoolExecutor(_UNDER_WAY)

        def one(chunk: Chunk) -> Result | Failure:
            try:
                with jax.enable_x64(wide):  # a setting of the calling thread
                    return compute(problem, chunk, workers)
            except (MemoryError, jax.errors.JaxRuntimeError) as error:
                return failure_of(error)

        source = iter(chunks)
        pending: dict[Future, Chunk] = {ahead.submit(one, chunk): chunk for chunk in islice(source, _UNDER_WAY)}
        try:
            while pending:
                done, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in done:
                    chunk = pending.pop(future)
                    for following in islice(source, 1):
                        pending[ahead.submit(one, following)] = following
                    yield chunk, future.result()
        finally:
            workers.shutdown(wait=False, cancel_futures=True)
            ahead.shutdown(wait=False, cancel_futures=True)


def failure_of(error: BaseException) -> Failure:
    """An error as the cause of a failure, in one line."""
    text = " ".join(str(error).split())
    return Failure(f"{type(error).__name__}: {text[:300]}" if text else type(error).__name__)
