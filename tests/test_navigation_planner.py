"""The planner against Dijkstra's algorithm of SciPy, and paths that can be worked out by hand."""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from qocjax.navigation import Grid, Planner, wavefront
from qocjax.navigation import plan as plan_eagerly

plan = jax.jit(plan_eagerly, static_argnames="grid")
GRID = Grid(0.05, (-1.0, 2.0), (22, 27))
MAPS = 240
SMALL = Grid(0.1, (0.0, 0.0), (11, 11))
BASE = Planner()
WIDE = Planner(tolerance=0.2, max_points=100)
CELL_ONLY = Planner(tolerance=0.0, max_points=300)


def graph(cost: np.ndarray, planner: Planner) -> coo_matrix:
    """Moves between cells of a costmap, written from the rule: one edge at a time."""
    rows, cols = cost.shape
    open_ = (cost < 253) | ((cost == 255) & planner.allow_unknown)
    ends, lengths = [], []
    for r, c in zip(*np.nonzero(open_), strict=True):
        for dr, dc in [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)]:
            if not (0 <= r + dr < rows and 0 <= c + dc < cols and open_[r + dr, c + dc]):
                continue
            if dr and dc and not (open_[r + dr, c] and open_[r, c + dc]):
                continue
            ends.append((r * cols + c, (r + dr) * cols + c + dc))
            share = min(cost[r + dr, c + dc], 252.0) / 252.0
            lengths.append(math.hypot(dr, dc) * (1 + planner.cost_travel_multiplier * share))
    sources, targets = np.array(ends).T if ends else np.zeros((2, 0), int)
    return coo_matrix((lengths, (sources, targets)), shape=(cost.size, cost.size)).tocsr()


@functools.cache
def random_maps() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Costmaps [MAPS, rows, cols] from open to crowded, with starts and goals [MAPS, 2] anywhere on them."""
    rng = np.random.default_rng(7)
    shape = (MAPS, *GRID.shape)
    crowded = np.linspace(0.0, 0.5, MAPS)[:, None, None]
    kind = rng.random(shape)
    cost = rng.integers(0, 253, shape) * (rng.random((MAPS, 1, 1)) < 0.7)
    cost = np.where(kind < crowded, rng.choice([253, 254], shape), np.where(kind > 0.97, 255, cost))
    low, high = np.array(GRID.extent)[[0, 2]], np.array(GRID.extent)[[1, 3]]
    start, goal = rng.uniform(low, high, (2, MAPS, 2))
    return cost.astype(float), start, goal


@functools.cache
def planned(allow_unknown: bool, maps: int):
    planner = Planner(tolerance=0.0, max_points=300, allow_unknown=allow_unknown)
    cost, start, goal = (each[:maps] for each in random_maps())
    made = plan(*map(jnp.asarray, (cost, start, goal)), GRID, planner)
    return planner, jax.tree.map(np.asarray, made)


def cells(points: np.ndarray) -> np.ndarray:
    return np.floor((points - GRID.origin) / GRID.resolution).astype(int)[..., ::-1]


@functools.cache
def from_dijkstra(allow_unknown: bool, maps: int) -> tuple[np.ndarray, list]:
    planner = Planner(tolerance=0.0, max_points=300, allow_unknown=allow_unknown)
    cost, start, goal = (each[:maps] for each in random_maps())
    graphs = [graph(each, planner) for each in cost]
    best = np.full(maps, np.inf)
    for k, (edges, a, b) in enumerate(zip(graphs, cells(start), cells(goal), strict=True)):
        ends = [cost[k][tuple(each)] for each in (a, b)]
        if all(c < 253 or (c == 255 and allow_unknown) for c in ends):
            index = np.ravel_multi_index(np.stack([a, b], axis=1), GRID.shape)
            best[k] = dijkstra(edges, indices=index[0])[index[1]]
    return best * GRID.resolution, graphs


@pytest.mark.parametrize(("allow_unknown", "maps"), [(True, MAPS), (False, 80)])
def test_the_cost_is_that_of_dijkstra_on_every_random_map(allow_unknown, maps):
    _, path = planned(allow_unknown, maps)
    best, _ = from_dijkstra(allow_unknown, maps)
    assert 0.2 < np.isfinite(best).mean() < 0.95  # the maps are neither all open nor all closed
    np.testing.assert_array_equal(path.reached, np.isfinite(best))
    np.testing.assert_allclose(path.cost, best, rtol=1e-12)


def test_the_points_are_a_path_of_that_cost_from_start_to_goal():
    _, path = planned(True, MAPS)
    _, graphs = from_dijkstra(True, MAPS)
    _, start, goal = random_maps()
    assert path.complete[path.reached].all()
    for k in np.flatnonzero(path.reached):
        count = path.num_points[k]
        trail = cells(path.points[k])
        index = np.ravel_multi_index(trail.T, GRID.shape)
        steps = np.asarray(graphs[k][index[: count - 1], index[1:count]]).ravel()
        assert (steps > 0).all()  # each is a move of the graph
        assert steps.sum() * GRID.resolution == pytest.approx(path.cost[k], rel=1e-12, abs=1e-12)
        np.testing.assert_array_equal(trail[0], cells(start[k]))
        np.testing.assert_array_equal(trail[count - 1 :], np.broadcast_to(cells(goal[k]), (300 - count + 1, 2)))
        apart = np.hypot(*np.diff(path.points[k], axis=0).T)
        assert path.length[k] == pytest.approx(apart.sum(), rel=1e-9, abs=1e-9)


def test_without_a_path_the_cost_is_infinite_and_the_points_stay_at_the_start():
    _, path = planned(True, MAPS)
    _, start, _ = random_maps()
    lost = ~path.reached
    assert np.isinf(path.cost[lost]).all() and not path.complete[lost].any() and (path.num_points[lost] == 1).all()
    assert (cells(path.points[lost]) == cells(start[lost])[:, None]).all()


def test_an_element_of_a_batch_is_the_single_plan():
    _, path = planned(True, MAPS)
    for k in (3, 120, 200):
        alone = plan(*(jnp.asarray(each[k]) for each in random_maps()), GRID, CELL_ONLY)
        for one, many in zip(alone, path, strict=True):
            np.testing.assert_allclose(one, many[k], rtol=1e-14)


def test_the_field_serves_many_starts():
    cost = np.zeros(SMALL.shape)
    cost[3:, 7], cost[2, 1:5] = 254, 90
    x, y = SMALL.centres()
    starts = np.stack(np.broadcast_arrays(x, y), axis=-1)
    path = plan(jnp.asarray(cost), jnp.asarray(starts), jnp.array([1.02, 0.97]), SMALL, BASE)
    to_goal = dijkstra(graph(cost, BASE).T, indices=9 * 11 + 10).reshape(SMALL.shape) * SMALL.resolution
    open_ = cost < 253
    np.testing.assert_allclose(np.asarray(path.cost)[open_], to_goal[open_], rtol=1e-12)
    assert np.asarray(path.reached)[open_].all()


def test_on_open_floor_the_path_does_not_hang_on_rounding():
    ends = jnp.array([0.05, 0.15]), jnp.array([1.05, 0.55])
    path = plan(jnp.zeros(SMALL.shape), *ends, SMALL, BASE)
    steps = np.diff(np.floor(np.asarray(path.points) / 0.1), axis=0)
    np.testing.assert_array_equal(steps[:10], [[1, 1]] * 4 + [[1, 0]] * 6)  # of all optimal ones, soonest near the goal


def test_all_maps_at_once_give_what_one_after_the_other_does():
    _, path = planned(True, MAPS)
    cost, start, goal = (each[:60] for each in random_maps())
    price = wavefront.price_of(jnp.asarray(cost), CELL_ONLY)
    maps, (a, b) = np.arange(60), (tuple(cells(each).T) for each in (start, goal))
    at_goal = np.isfinite(price)[maps, *b]
    begin = jnp.full(cost.shape, jnp.inf).at[maps, *b].set(np.where(at_goal, 0.0, np.inf))
    found = jax.jit(wavefront.settle)(begin, price)[maps, *a] * GRID.resolution  # as on an accelerator
    np.testing.assert_allclose(found, np.where(np.isfinite(price)[maps, *a], path.cost[:60], np.inf), rtol=1e-12)


def test_an_empty_map_gives_the_octile_distance():
    cost, start, goal = random_maps()
    path = plan(jnp.zeros(cost.shape), jnp.asarray(start), jnp.asarray(goal), GRID, CELL_ONLY)
    away = abs(cells(start) - cells(goal))
    expected = 0.05 * (abs(away[:, 0] - away[:, 1]) + math.sqrt(2) * away.min(axis=1))
    np.testing.assert_allclose(path.cost, expected, rtol=1e-12)
    np.testing.assert_allclose(path.length, expected, rtol=1e-12)
    np.testing.assert_array_equal(path.num_points, away.max(axis=1) + 1)


def test_the_path_past_nav2s_square_takes_one_cell_more_than_smac():
    # nav2_smac_planner, test_a_star.cpp: 82 cells there, where a diagonal may pass the corner of a closed cell.
    cost = np.zeros((100, 100))
    cost[40:61, 40:61] = 254.0
    path = plan(
        jnp.asarray(cost), jnp.array([2.05, 2.05]), jnp.array([8.05, 8.05]), Grid(0.1, (0.0, 0.0), (100, 100)), BASE
    )
    assert bool(path.reached) and int(path.num_points) == 83


def test_no_diagonal_leads_past_a_closed_corner():
    room = jnp.full(SMALL.shape, 254.0).at[:3, :3].set(0.0).at[1, 1].set(253.0)  # a ring of eight cells
    ends = jnp.array([0.05, 0.15]), jnp.array([0.15, 0.05])
    assert float(plan(room, *ends, SMALL, BASE).cost) == pytest.approx(0.2)  # around the corner [0, 0]
    other_way = plan(room.at[0, 0].set(254.0), *ends, SMALL, BASE)
    assert float(other_way.cost) == pytest.approx(0.6)  # and not the diagonal between the two closed cells


def test_a_costly_corridor_is_left_for_a_free_detour():
    cost = jnp.zeros(SMALL.shape).at[1, 1:10].set(252.0)
    ends = jnp.array([0.05, 0.15]), jnp.array([1.05, 0.15])
    cheap = plan(cost, *ends, SMALL, Planner(cost_travel_multiplier=0.0))
    dear = plan(cost, *ends, SMALL, BASE)
    assert float(cheap.cost) == pytest.approx(1.0)  # straight through
    assert float(dear.cost) == pytest.approx(0.1 * (8 + 2 * math.sqrt(2)))  # beside it; through would be 2.8
    assert float(dear.length) == pytest.approx(0.1 * (8 + 2 * math.sqrt(2)))


def test_a_winding_path_takes_many_rounds_and_points():
    walls = np.zeros(SMALL.shape)
    for r in range(1, 11, 2):
        walls[r] = 254
        walls[r, -1 if (r // 2) % 2 == 0 else 0] = 0
    ends = jnp.array([0.05, 0.05]), jnp.array([0.05, 1.05])
    path = plan(jnp.asarray(walls), *ends, SMALL, WIDE)
    moves = 6 * 10 + 5 * 2  # six corridors and five passages between them; no diagonal fits around a corner
    assert float(path.cost) == pytest.approx(0.1 * moves)
    assert bool(path.complete) and int(path.num_points) == moves + 1
    short = plan(jnp.asarray(walls), *ends, SMALL, BASE)
    assert bool(short.reached) and not bool(short.complete) and int(short.num_points) == sum(SMALL.shape)
    np.testing.assert_array_equal(short.points, path.points[: sum(SMALL.shape)])


def test_a_closed_goal_moves_to_the_nearest_open_cell_within_the_tolerance():
    cost = jnp.zeros(SMALL.shape).at[4:7, 4:7].set(254.0)
    ends = jnp.array([0.05, 0.55]), jnp.array([0.55, 0.55])
    assert not bool(plan(cost, *ends, SMALL, BASE).reached)
    near = plan(cost, *ends, SMALL, WIDE)
    assert bool(near.complete)
    assert float(jnp.hypot(*(near.points[-1] - ends[1]))) == pytest.approx(0.2)


def test_a_closed_start_leaves_by_the_nearest_cell_with_a_path():
    cost = jnp.zeros(SMALL.shape).at[4:7, 0:2].set(253.0)
    path = plan(cost, jnp.array([0.15, 0.55]), jnp.array([1.05, 0.55]), SMALL, BASE)
    assert bool(path.complete) and int(path.num_points) == 9
    np.testing.assert_allclose(path.points[0], (0.25, 0.55))


def test_an_open_start_is_not_put_beyond_the_wall_around_it():
    cost = jnp.zeros(SMALL.shape).at[:, 3].set(254.0)
    path = plan(cost, jnp.array([0.25, 0.55]), jnp.array([1.05, 0.55]), SMALL, WIDE)
    assert not bool(path.reached) and np.isinf(float(path.cost))


def test_beside_the_map_there_is_no_path():
    inside, beside = jnp.array([0.25, 0.25]), jnp.array([0.25, -0.01])
    for ends in ((inside, beside), (beside, inside), (inside, jnp.array([jnp.nan, 0.2]))):
        assert not bool(plan(jnp.zeros(SMALL.shape), *ends, SMALL, BASE).reached)


def test_single_precision_agrees():
    cost, start, goal = (jnp.asarray(each[:40], jnp.float32) for each in random_maps())
    path = plan(cost, start, goal, GRID, CELL_ONLY)
    best, _ = from_dijkstra(True, MAPS)
    np.testing.assert_allclose(path.cost, best[:40], rtol=1e-6)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cost_travel_multiplier": -1.0}, "cost_travel_multiplier: got -1.0, expected >= 0"),
        ({"tolerance": float("nan")}, "tolerance: got nan, expected finite numbers"),
        ({"max_points": 1}, "max_points: got 1, expected at least 2"),
    ],
)
def test_wrong_parameters_are_named(values, message):
    with pytest.raises(ValueError, match=message):
        Planner(**values)
