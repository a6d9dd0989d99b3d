"""Maps in figures: what is drawn of those larger than their panels, and that small ones are drawn as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from test_lazy import imported
from test_show import ROOM, a_run, view

from qocjax._beside import process_beside
from qocjax.cost_values import INSCRIBED, LETHAL, UNKNOWN
from qocjax.figures.cells import SEEN, Cells, coarser, pixel_edges, seen_part
from qocjax.figures.shown import RunFigures

RANDOM = np.random.default_rng(7)
TABLE = np.full((SEEN + 1, 4), 255, np.uint8)
TABLE[LETHAL, :3], TABLE[SEEN, :3], TABLE[INSCRIBED, :3] = 0, (0, 0, 255), (255, 0, 0)


def matters(cost: np.ndarray) -> np.ndarray:
    """How much a cost matters, written down once more: obstacles, closed cells, unknown ones, open ones by cost."""
    ranks = {LETHAL: 1000, SEEN: 999, INSCRIBED: 998, UNKNOWN: 997}
    return np.vectorize(lambda each: ranks.get(int(each), int(each)))(cost)


def a_map(rows: int, cols: int) -> np.ndarray:
    """Free but for walls of one cell, and a few cells of every kind."""
    cost = np.zeros((rows, cols), np.uint16)
    cost[:, RANDOM.integers(cols, size=2)] = LETHAL
    cost[RANDOM.integers(rows, size=2)] = LETHAL
    few = RANDOM.random(cost.shape) < 0.02
    cost[few] = RANDOM.integers(0, SEEN + 1, few.sum())
    return cost


@pytest.mark.parametrize("trial", range(30))
def test_a_block_is_the_cell_that_matters_most(trial: int) -> None:
    rows, cols = RANDOM.integers(1, 60, 2)
    cost, limits = a_map(rows, cols), RANDOM.integers(1, 70, 2)
    shown = coarser(cost, *map(int, limits))
    assert shown.shape == tuple(np.minimum(cost.shape, limits))
    block_of = [np.arange(n) for n in cost.shape]
    for axis, (n, m) in enumerate(zip(cost.shape, shown.shape, strict=True)):
        block_of[axis] = np.searchsorted(np.arange(m) * n // m, np.arange(n), side="right") - 1
        # A cell is drawn less than its own width from where it lies, and blocks differ by one cell at most.
        assert (np.abs(block_of[axis] * n / m - np.arange(n)) < n / m).all()
        assert np.ptp(np.bincount(block_of[axis])) <= 1
    most = np.zeros(shown.shape, int)
    np.maximum.at(most, np.ix_(*block_of), matters(cost))
    np.testing.assert_array_equal(matters(shown), most)


def test_what_fits_is_the_map_itself() -> None:
    cost = a_map(40, 30)
    assert coarser(cost, 40, 30) is cost and coarser(cost, 90, 31) is cost


def test_a_window_holds_every_cell_that_it_touches() -> None:
    assert seen_part(10, 2.0, 4.0) == slice(2, 4)
    assert seen_part(10, 2.9, 4.1) == slice(2, 5) == seen_part(10, 4.1, 2.9)
    assert seen_part(10, -5.0, 99.0) == slice(0, 10)
    assert seen_part(10, 20.0, 30.0) == slice(9, 10) and seen_part(10, -9.0, -3.0) == slice(0, 1)


@pytest.mark.parametrize("trial", range(40))
def test_each_cell_of_a_crowded_map_is_in_one_pixel_and_near_it(trial: int) -> None:
    count = int(RANDOM.integers(2, 300))
    size = count * RANDOM.uniform(0.1, 1.0)
    low = RANDOM.uniform(-3.0, 40.0)
    begin = np.rint(low if trial % 2 else low + RANDOM.uniform(0.0, size / 3))  # the whole map, or from within
    end = max(begin + 1, np.rint(low + size if trial % 4 < 2 else low + RANDOM.uniform(size / 2, size)))
    edges = pixel_edges(count, low, low + size, begin, end)
    assert edges.size == end - begin + 1 and (np.diff(edges) >= 0).all()
    if abs(begin - low) <= 0.5:
        assert edges[0] == 0
    if abs(end - low - size) <= 0.5:
        assert edges[-1] == count
    for pixel, cells in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        first, last = (low + np.array((cells[0], max(cells[1] - 1, cells[0]))) * size / count) - begin - pixel
        assert -1.0 <= first and last < 1.5  # begins in the pixel, or half a pixel off at the edge of the map


def drawn(cost: np.ndarray, limits: tuple[float, ...] | None = None, own: bool = True) -> tuple[np.ndarray, Cells]:
    """Pixels of axes that fill a picture of 200 x 200, [row from below, col, RGB], with a map of 10 x 10 m."""
    figure = Figure(figsize=(2, 2), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    cells = Cells(axes, (0.0, 10.0, 0.0, 10.0), cost, TABLE)
    assert axes.get_xlim() == axes.get_ylim() == (0.0, 10.0) and axes.get_aspect() == 1.0
    if not own:
        cells.remove()
        axes.imshow(TABLE[cost], extent=(0, 10, 0, 10), origin="lower", interpolation="none", zorder=1)
    axes.set_axis_off()
    if limits is not None:
        axes.set(xlim=limits[:2], ylim=limits[2:])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[::-1, :, :3], cells


@pytest.mark.parametrize("size", [201, 333, 777, 1000])
def test_walls_of_one_cell_are_whole_on_the_smallest_panel(size: int) -> None:
    cost = np.zeros((size, size), np.uint16)
    places = np.sort(RANDOM.choice(size, 12, replace=False))
    cost[:, places] = LETHAL
    pixels, _ = drawn(cost)
    dark = (pixels == 0).all(axis=(0, 2))
    where = (places + 0.5) * 200 / size
    assert all(dark[max(0, int(at) - 1) : int(at) + 2].any() for at in where)  # each where it stands
    found = np.flatnonzero(dark)
    assert (np.abs(found[:, None] + 0.5 - where).min(axis=1) < 1.5).all()  # and none elsewhere
    across, _ = drawn(cost.T)
    np.testing.assert_array_equal(across, pixels.transpose(1, 0, 2))


@pytest.mark.parametrize(
    ("shape", "limits"),
    [
        ((1, 1), None), ((40, 30), None), ((200, 200), None), ((40, 30), (2.0, 5.0, 4.0, 7.0)),
        ((200, 200), (2.0, 5.0, 4.0, 7.0)), ((40, 30), (-3.0, 15.0, -1.0, 17.0)),
    ],
)  # fmt: skip
def test_a_small_map_is_drawn_pixel_by_pixel_as_matplotlib_does(
    shape: tuple[int, int], limits: tuple[float, ...] | None
) -> None:
    cost = a_map(*shape)
    np.testing.assert_array_equal(drawn(cost, limits)[0], drawn(cost, limits, own=False)[0])


def test_a_close_view_draws_the_cells_it_shows_as_they_are() -> None:
    cost = a_map(1000, 1000)
    pixels, cells = drawn(cost, (3.0, 3.5, 6.0, 6.5))
    shown, extent = cells.shown(1.0)
    np.testing.assert_allclose(extent, (3.0, 3.5, 6.0, 6.5), atol=0.0101)
    assert shown.shape[0] in (50, 51) and shown.shape[1] in (50, 51)
    np.testing.assert_array_equal(pixels[2::4, 2::4], TABLE[cost[600:650, 300:350]][..., :3])


def test_a_window_of_a_crowded_map_keeps_its_walls_where_they_are() -> None:
    cost = np.zeros((1000, 1000), np.uint16)
    cost[:, [251, 400, 555]], cost[640] = LETHAL, SEEN
    pixels, _ = drawn(cost, (2.5, 7.5, 2.5, 7.5))
    assert set(np.flatnonzero((pixels == 0).all(axis=(0, 2)))) == {0, 60, 122}
    assert set(np.flatnonzero((pixels[:, 10] == (0, 0, 255)).all(axis=-1))) == {156}


@pytest.mark.parametrize(("finer", "side"), [(1.0, 200), (2.0, 400)])
def test_what_is_drawn_lies_where_the_map_lies(finer: float, side: int) -> None:
    _, cells = drawn(a_map(999, 777))
    shown, extent = cells.shown(1.0, finer)
    assert shown.shape == (side, side)
    np.testing.assert_allclose(extent, (0, 10, 0, 10), rtol=1e-12)


def test_figures_of_a_run_are_the_same_files_with_a_process_beside(tmp_path: Path) -> None:
    def draw(folder: Path, pool: object) -> list[Path]:
        figures = RunFigures(a_run(), folder, ROOM, pool)  # type: ignore[arg-type]
        figures.add_film("run.gif", 2.0, 1.0, "title")
        figures.add_views([view(0), view(1)], 1)
        return figures.finished()

    with process_beside("qocjax.figures.shown") as pool:
        both = draw(tmp_path / "both", pool)
    alone = draw(tmp_path / "alone", None)
    names = [path.name for path in alone]
    assert names == [path.name for path in both] == [
        "trajectories.png", "trajectories.pdf", "run.gif", "costmaps.png", "costmaps.pdf",
        "costmap_robot2.png", "costmap_robot2.pdf",
    ]  # fmt: skip
    for one, other in zip(alone, both, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_what_draws_a_run_and_what_checks_its_options_import_no_more_than_they_need() -> None:
    assert "jax" not in imported("import qocjax.figures.shown")
    assert imported("import qocjax.config.show") == {"jax", "numpy", "pydantic"}
