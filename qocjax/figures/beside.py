"""Drawing figures on two cores: a process beside this one takes half of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from qocjax.figures.save import save

__all__ = ["Drawing", "Drawings", "draw_all"]

# What makes the figure, picklable, and where it goes (path without suffix).
Drawing = tuple[Callable[[], Figure], Path]

Work = Callable[[], Sequence[Path]]  # draws, picklable where there is a pool; returns the files


class Drawings:
    """Figures that the pool draws from the first on, and this process from the last, until they meet."""

    def __init__(self, pool: Executor | None = None) -> None:
        """Begins with none.

        Args:
            pool: From `process_beside`; None draws all here. A pool that breaks costs time, no figure.
        """
        self._pool = pool
        self._works: list[tuple[Work, Future | None]] = []

    def add(self, work: Work) -> None:
        """Hands one to the pool, which begins with it as soon as it has drawn those before."""
        self._works.append((work, self._pool.submit(work) if self._pool else None))

    def finished(self) -> list[Path]:
        """The files of all of them, in their order, when they are drawn."""
        done: dict[int, Sequence[Path]] = {}
        for k, (work, future) in reversed([*enumerate(self._works)]):
            if future is None or future.cancel():
                done[k] = work()
        for k, (work, future) in enumerate(self._works):
            if k not in done and future is not None:
                try:
                    done[k] = future.result()
                except BrokenExecutor:
                    done[k] = work()
        return [path for k in sorted(done) for path in done[k]]


def draw_all(drawings: Sequence[Drawing], pool: Executor | None = None, last: Drawing | None = None) -> list[Path]:
    """Makes and saves figures.

    Args:
        drawings: What to draw.
        pool: Helps, see `Drawings`.
        last: Drawn here, while the pool begins with the others: what is still to be worked out for it.

    Returns:
        The files in the order of the drawings, a PNG and a PDF of each.
    """
    others = Drawings(pool)
    for drawing in drawings:
        others.add(partial(_draw, drawing))
    own = [] if last is None else _draw(last)
    return [*others.finished(), *own]


def _draw(drawing: Drawing) -> list[Path]:
    make, stem = drawing
    return save(make(), stem)
