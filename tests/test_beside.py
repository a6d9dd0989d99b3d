"""Figures drawn by two processes."""

from __future__ import annotations

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from matplotlib.figure import Figure

from qocjax._beside import process_beside
from qocjax.figures.beside import draw_all


def line(slope: float) -> Figure:
    figure, axes = plt.subplots()
    axes.plot([0, 1], [0, slope])
    plt.close(figure)
    return figure


def drawings(folder: Path) -> list:
    return [(partial(line, k), folder / f"line_{k}") for k in range(4)]


def names(paths: list[Path]) -> list[str]:
    return [path.name for path in paths]


@pytest.mark.slow
def test_files_and_their_order_are_those_of_one_process(tmp_path: Path) -> None:
    alone = draw_all(drawings(tmp_path / "alone"))
    with process_beside() as pool:
        both = draw_all(drawings(tmp_path / "both"), pool)
    assert names(both) == names(alone) == [f"line_{k}.{kind}" for k in range(4) for kind in ("png", "pdf")]
    assert [path.read_bytes() for path in both] == [path.read_bytes() for path in alone]


class _Broken(Executor):
    def submit(self, *_args: object, **_options: object) -> Future:
        future: Future = Future()
        future.set_running_or_notify_cancel()
        future.set_exception(BrokenProcessPool("gone"))
        return future


def test_a_process_that_dies_costs_no_figure(tmp_path: Path) -> None:
    paths = draw_all(drawings(tmp_path), _Broken())
    assert all(path.stat().st_size > 0 for path in paths) and len(paths) == 8


def test_an_error_of_a_drawing_is_raised(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(TypeError):
        draw_all([(partial(line, 1, 2), tmp_path / "none"), (partial(line, 1), tmp_path / "one")], pool)
