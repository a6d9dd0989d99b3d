"""Drawing figures on two cores: a process beside this one takes half of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path

from matplotlib.figure import Figure

from qocjax.figures.save import save

__all__ = ["Drawing", "draw_all"]

# What makes the figure, picklable, and where it goes (path without suffix).
Drawing = tuple[Callable[[], Figure], Path]


def draw_all(drawings: Sequence[Drawing], pool: Executor | None = None, last: Drawing | None = None) -> list[Path]:
    """Makes and saves figures: the pool from the first on, this process from the last, until they meet.

    Args:
        drawings: What to draw.
        pool: From `process_beside`; None draws all here. A pool that breaks costs time, no figure.
        last: Drawn here, while the pool begins with the others: what is still to be worked out for it.

    Returns:
        The files in the order of the drawings, a PNG and a PDF of each.
    """
    sent: list[Future | None] = [pool.submit(_draw, each) if pool else None for each in drawings]
    done = {} if last is None else {len(drawings): _draw(last)}
    for k in reversed(range(len(drawings))):
        future = sent[k]
        if future is None or future.cancel():
            done[k] = _draw(drawings[k])
    for k, future in enumerate(sent):
        if k not in done and future is not None:
            try:
                done[k] = future.result()
            except BrokenExecutor:
                done[k] = _draw(drawings[k])
    return [path for k in sorted(done) for path in done[k]]


def _draw(drawing: Drawing) -> list[Path]:
    make, stem = drawing
    return save(make(), stem)
