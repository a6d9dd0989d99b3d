"""A large map's windows, settled best first, against sweeps over the whole map: every bit of every path."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from qocjax.navigation import Grid, Path, Planner, best_first, cost_to_go, plan
from qocjax.navigation.field import field_to, open_near

GRID = Grid(0.05, (-1.0, 2.0), (53, 71))
PLANNER = Planner(tolerance=0.12)
KINDS = ("open", "costly", "rooms", "maze", "crowded", "walls", "shut")
EACH = 10  # maps of each kind


def maze(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Corridors of two cells without loops, by a walk that goes back where it cannot go on."""
    cost, (rows, cols) = np.full(shape, 254), ((n - 1) // 3 for n in shape)
    rows, cols = int(rows), int(cols)
    seen, trail = np.zeros((rows, cols), bool), [(0, 0)]
    seen[0, 0] = True
    cost[1:3, 1:3] = 0
    while trail:
        r, c = trail[-1]
        ways = [(r + a, c + b) for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))
                if 0 <= r + a < rows and 0 <= c + b < cols and not seen[r + a, c + b]]  # fmt: skip
        if not ways:
            trail.pop()
            continue
        nr, nc = ways[rng.integers(len(ways))]
        top, left = 3 * min(r, nr) + 1, 3 * min(c, nc) + 1
        cost[top : 3 * max(r, nr) + 3, left : 3 * max(c, nc) + 3] = 0
        seen[nr, nc] = True
        trail.append((nr, nc))
    return cost


def rooms(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Rooms with a door in each wall, and costs that fall off from the walls."""
    walls = np.zeros(shape, bool)
    for axis in (0, 1):
        for at in range(12, shape[axis] - 4, 13):
            lines = np.moveaxis(walls, axis, 0)
            lines[at] = True
            for door in range(0, lines.shape[1], 13):
                begin = door + rng.integers(2, 9)
                lines[at, begin : begin + 3] = False
    away = distance_transform_edt(~walls)
    return np.where(walls, 254, np.floor(252 * np.exp(-0.7 * away))).astype(int)


def drawn(kind: str, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    if kind == "open":
        return np.zeros(shape, int)
    if kind == "costly":
        smooth = gaussian_filter(rng.normal(size=shape), 3.0)
        return np.clip(900 * smooth, 0, 252).astype(int)
    if kind in ("rooms", "maze"):
        return globals()[kind](rng, shape)
    if kind == "crowded":
        return np.where(rng.random(shape) < 0.3, rng.choice([253, 254], shape), rng.integers(0, 253, shape))
    cost = rng.integers(0, 60, shape)
    cost[:, shape[1] // 2] = 254
    if kind == "walls":  # the way leads round by the edge
        cost[0 if rng.random() < 0.5 else -1, shape[1] // 2] = 0
    return cost


@functools.cache
def cases() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Costs [B, rows, cols], starts and goals [B, 2]: some the same, some at an edge, many in closed cells."""
    rng = np.random.default_rng(3)
    cost = np.stack([drawn(kind, rng, GRID.shape) for kind in KINDS for _ in range(EACH)])
    cost = np.where(rng.random(cost.shape) < 0.003, 255, cost)
    low, high = np.array(GRID.extent)[[0, 2]] + 1e-6, np.array(GRID.extent)[[1, 3]] - 1e-6
    start, goal = rng.uniform(low, high, (2, len(cost), 2))
    goal[::EACH] = start[::EACH]
    goal[1::EACH, 0], start[2::EACH, 1] = high[0], low[1]
    near = start + rng.uniform(-0.4, 0.4, start.shape)
    goal[3::EACH] = np.clip(near[3::EACH], low, high)
    return cost.astype(np.uint8), start, goal


def planned(windows: bool, batched: bool = True, x64: bool = True) -> Path:
    """All cases, compiled anew."""
    with pytest.MonkeyPatch.context() as patch, jax.enable_x64(x64):
        patch.setattr(best_first, "_LEAST", 0 if windows else np.inf)
        one = lambda cost, start, goal: plan(cost, start, goal, GRID, PLANNER)  # noqa: E731
        all_ = one if batched else jax.vmap(one)
        return jax.tree.map(np.asarray, jax.jit(all_)(*map(jnp.asarray, cases())))


@functools.cache
def whole(x64: bool = True) -> Path:
    return planned(windows=False, x64=x64)


def assert_equal(some: Path, others: Path) -> None:
    for name, one, other in zip(Path._fields, some, others, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.parametrize("side", [10, pytest.param(60, marks=pytest.mark.slow)])
def test_paths_are_those_of_the_whole_map(side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(best_first, "_SIDE", side)
    path = whole()
    shares = {kind: path.reached[k * EACH :][:EACH].mean() for k, kind in enumerate(KINDS)}
    assert shares["open"] == 1 and 0 < shares["shut"] < 1 and 0.3 < path.reached.mean() < 0.95
    assert_equal(planned(windows=True), path)


def test_paths_are_those_of_the_whole_map_in_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(best_first, "_SIDE", 16)
    path = planned(windows=True, x64=False)
    assert path.points.dtype == np.float32
    assert_equal(path, whole(x64=False))


@pytest.mark.slow
def test_paths_are_those_of_the_whole_map_under_vmap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(best_first, "_SIDE", 24)
    path = planned(windows=True, batched=False)
    np.testing.assert_allclose(path.length, whole().length, rtol=1e-14)  # moves added up in another order
    assert_equal(path._replace(length=whole().length), whole())


def test_all_windows_together_give_the_whole_field(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(best_first, "_SIDE", 24)
    cost, _, goal = (jnp.asarray(each) for each in cases())
    fields = []
    for least in (0, np.inf):
        monkeypatch.setattr(best_first, "_LEAST", least)
        fields.append(np.asarray(jax.jit(lambda *all_: cost_to_go(*all_, GRID, PLANNER))(cost, goal)))
    assert 0.2 < np.isfinite(fields[0]).mean() < 0.95
    np.testing.assert_array_equal(*fields)


def test_a_short_way_leaves_most_of_a_large_map_alone() -> None:
    grid = Grid(0.05, (0.0, 0.0), (400, 500))
    cost = jnp.zeros(grid.shape, jnp.uint8).at[60:280, 250].set(254)
    start, goal = jnp.array([12.0, 9.0]), jnp.array([13.0, 9.0])  # to either side of the wall, 5 m from its end
    beyond, beside, end = (open_near(each, cost, grid, PLANNER) for each in (start, goal + 0.5, goal))
    field = jax.jit(lambda begin: field_to(end, cost, grid, PLANNER, begin))
    whole = np.asarray(jax.jit(lambda: field_to(end, cost, grid, PLANNER))())
    found, near = np.asarray(field(beyond)), np.asarray(field(beside))
    at = int(beyond.row), int(beyond.col)
    assert found[at] == whole[at] and np.isfinite(whole[at])
    assert (found >= whole).all() and (near >= whole).all()
    assert np.isfinite(near).mean() < 0.25 < np.isfinite(found).mean() < 0.8 < np.isfinite(whole).mean()


@pytest.mark.parametrize("shape", [(1, 300), (2, 65), (16, 16), (17, 16), (129, 40), (3, 1000), (258, 259)])
@pytest.mark.parametrize("side", [4, 16, 128])
def test_any_two_neighbours_lie_in_a_window_and_in_one_beside_it(
    shape: tuple[int, int], side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(best_first, "_SIDE", side)
    windows = best_first._Windows.over(shape)
    for cells, width, firsts in zip(shape, windows.shape, (windows.rows, windows.cols), strict=True):
        assert width == min(side, cells) and firsts[0] == 0 and firsts[-1] == cells - width
        assert (np.diff(firsts) <= width - 2).all() and (np.diff(firsts) > 0).all()
