"""The oracles of edges and cells: against the check values of the model (sections 12 and 13) and closed forms."""

from __future__ import annotations

import heapq
import math
from typing import Any

import numpy as np
import pytest
from slow_cell import cell_loop
from slow_edge import DISCIPLINES, edge, edge_loop
from test_slow_loop import check_loop_times

from qocjax import Design, Scenario, simulate

DEADLINE = 0.3

# workers, per robot, discipline, abort; completed and finished share; tick and loop time of robot 0; AUC of both robots
EDGES = [
    (1, True, "unlimited", False, 0.8180, 1.0, {0: 0.121, 1: 0.261, 2: 0.181}, (3.8558, 3.8932)),
    (1, True, "skip", False, 0.0507, 0.0507, {0: 0.121, 13: 0.181, 32: 0.201}, (4.2730, 4.1144)),
    (1, True, "latest", False, 0.0357, 0.0450, {0: 0.121, 12: 0.262, 38: 0.163}, (5.3224, 4.2598)),
    (2, True, "skip", False, 0.0672, 0.0865, {0: 0.121, 1: 0.261, 13: 0.181}, (3.8547, 4.3458)),
    (3, False, "skip", False, 0.0682, 0.0733, {0: 0.121, 34: 0.261, 38: 0.161}, (4.1140, 4.6530)),
    (3, False, "latest", False, 0.0528, 0.0665, {0: 0.121, 12: 0.262, 33: 0.122}, (4.3863, 4.2271)),
    (1, True, "latest", True, 0.0495, 0.0495, {0: 0.121, 12: 0.262, 38: 0.163}, (4.4033, 3.9009)),
]


def check_edge(row: int, exact: bool, shorter: float = 0.0) -> np.ndarray:
    """Loop times of a row of the table, with computations that are some seconds shorter."""
    workers, per_robot, discipline, abort, *_ = EDGES[row]
    compute = check_loop_times(3000) - shorter
    nothing = np.zeros_like(compute)
    options = {"workers": workers, "per_robot": per_robot, "discipline": discipline, "exact": exact}
    return edge_loop(nothing, compute, nothing, 0.01, **options, deadline=DEADLINE if abort else None)


def completed(loop_times: np.ndarray) -> float:
    return float(np.mean(loop_times <= DEADLINE * (1 + 1e-6)))


@pytest.mark.parametrize("row", range(len(EDGES)))
def test_check_values_of_the_edge(row: int) -> None:
    *_, share, finished, first, auc = EDGES[row]
    times = check_edge(row, exact=False)
    np.testing.assert_allclose([completed(times), np.isfinite(times).mean()], [share, finished], rtol=0, atol=5.1e-5)
    ticks = np.flatnonzero(np.isfinite(times[:, 0]))[:3]
    assert ticks.tolist() == list(first)
    np.testing.assert_allclose(times[ticks, 0], list(first.values()), rtol=0, atol=1e-9)
    run = simulate(Scenario(start_jitter=(0.0, 0.0)), Design(deadline=DEADLINE, tau=0.01), times, "deadline")
    np.testing.assert_allclose(run.auc, auc, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("row", range(len(EDGES)))
def test_a_tie_is_an_end_just_before_the_arrival(row: int) -> None:
    """Exact sums are the limit of shorter computations. Only where samples wait do rounding errors add up to others."""
    times = check_edge(row, exact=True)
    np.testing.assert_allclose(check_edge(row, exact=True, shorter=1e-9), times, rtol=0, atol=1e-6)
    same = np.array_equal(np.isfinite(times), np.isfinite(check_edge(row, exact=False)))
    assert same == (EDGES[row][2] != "latest")


@pytest.mark.parametrize("discipline", ["skip", "latest", "fifo"])
@pytest.mark.parametrize("per_robot", [True, False])
def test_enough_workers_are_unlimited(discipline: str, per_robot: bool) -> None:
    rng = np.random.default_rng(0)
    up, compute, down = rng.uniform(0, 0.1, (3, 50, 3))
    up[rng.random(up.shape) < 0.2] = np.inf
    for deadline in (None, 0.1):
        times = edge_loop(
            up, compute, down, 0.01, workers=150, per_robot=per_robot, discipline=discipline, deadline=deadline
        )
        expected = np.where(up + compute <= (deadline or np.inf), up + compute + down, np.inf)
        np.testing.assert_allclose(times, expected, atol=1e-11)


def one_robot(compute: float, discipline: str, ticks: int = 10, deadline: float | None = None) -> Any:
    """One robot, one worker, a constant time of computation; tau is 1 s."""
    shape = (ticks, 1)
    return edge(
        np.zeros(shape), np.full(shape, compute), 1.0, workers=1, per_robot=True, discipline=discipline,
        deadline=deadline,
    )  # fmt: skip


def finite(end: np.ndarray) -> dict[int, float]:
    return {int(p): float(end[p, 0]) for p in np.flatnonzero(np.isfinite(end[:, 0]))}


def test_one_robot_and_one_worker() -> None:
    assert finite(one_robot(3.0, "skip").end) == {0: 3, 3: 3, 6: 3, 9: 3}
    assert finite(one_robot(2.5, "skip").end) == {0: 2.5, 3: 2.5, 6: 2.5, 9: 2.5}
    assert finite(one_robot(1.5, "fifo").end) == {p: 1.5 + 0.5 * p for p in range(10)}
    # At 5 and 10 s a computation ends as a sample arrives: who waits goes first, the newcomer takes the place.
    assert finite(one_robot(2.5, "latest").end) == {0: 2.5, 2: 3.0, 4: 3.5, 7: 3.0, 9: 3.5}
    assert one_robot(2.5, "latest").busy == 12.5


def test_abort() -> None:
    assert finite(one_robot(2.0, "skip", deadline=2.0).end) == {p: 2 for p in range(0, 10, 2)}
    late = one_robot(2.001, "skip", deadline=2.0)
    assert finite(late.end) == {}
    assert finite(late.start) == {p: 0 for p in range(0, 10, 2)}
    assert late.busy == 10
    # Each waits half a second longer, until sample 3 is given up at 5.6 s, and sample 4 begins then.
    fifo = one_robot(1.5, "fifo", ticks=5, deadline=2.6)
    assert finite(fifo.end) == {0: 1.5, 1: 2.0, 2: 2.5}
    assert finite(fifo.start) == {0: 0, 1: 0.5, 2: 1.0, 3: 1.5, 4: 1.6}
    assert fifo.busy == pytest.approx(4.5 + 1.1 + 1.0)


def test_a_wait_is_given_up_before_its_worker_is_idle() -> None:
    """Of two samples of a tick, the second would begin when both are given up."""
    nothing = np.zeros((4, 2))
    served = edge(nothing, nothing + 3, 1.0, workers=1, per_robot=False, discipline="fifo", deadline=2.0)
    np.testing.assert_array_equal(served.start, [[0, np.inf], [np.inf, 1], [1, np.inf], [np.inf, 1]])
    assert np.isinf(served.end).all()
    assert served.busy == 5


def test_what_arrives_at_the_deadline_takes_nothing() -> None:
    up, compute = np.array([[1.0], [0.5]]), np.array([[0.0], [0.2]])
    for discipline in DISCIPLINES:
        served = edge(up, compute, 1.0, workers=1, per_robot=True, discipline=discipline, deadline=1.0)
        assert finite(served.end) == {1: 0.7}


def test_a_replaced_sample_leaves_its_turn() -> None:
    """Robot 1 waits first. Its newer sample still goes before that of robot 0."""
    up, compute = np.array([[0.0, 0.2], [0.0, 0.2]]), np.full((2, 2), 2.5)
    times = edge_loop(up, compute, 0 * up, 1.0, workers=1, per_robot=False, discipline="latest")
    np.testing.assert_array_equal(times, [[2.5, np.inf], [6.5, 4.0]])


def test_a_place_that_was_given_up_takes_a_new_turn() -> None:
    """Robot 1 gives up at 3 s and waits anew from 3.1 s on, behind robot 2, which ends exactly at its deadline."""
    up = np.full((4, 3), np.inf)
    up[1, 0], up[0, 1], up[1, 2], up[3, 1] = 0.0, 1.2, 0.5, 0.1
    compute = np.full((4, 3), 0.5)
    compute[1, 0] = 2.5
    times = edge_loop(up, compute, np.zeros((4, 3)), 1.0, workers=1, per_robot=False, discipline="latest", deadline=3.0)
    expected = np.full((4, 3), np.inf)
    expected[1, 0], expected[1, 2], expected[3, 1] = 2.5, 3.0, 1.5
    np.testing.assert_array_equal(times, expected)


def test_an_older_sample_does_not_replace_a_newer_one() -> None:
    up, compute = np.array([[0.0], [1.5], [0.1]]), np.full((3, 1), 3.0)
    assert finite(edge(up, compute, 1.0, workers=1, per_robot=True, discipline="latest").end) == {0: 3.0, 2: 4.0}


def test_one_instant_is_taken_in_rotating_order() -> None:
    """Each robot in turn finds the only worker idle."""
    nothing, compute = np.zeros((7, 3)), np.full((7, 3), 0.01)
    times = edge_loop(nothing, compute, nothing, 0.01, workers=1, per_robot=False, discipline="skip")
    np.testing.assert_array_equal(np.isfinite(times), np.arange(7)[:, None] % 3 == np.arange(3)[None, :])


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_fifo_is_a_queue_of_many_servers(workers: int) -> None:
    """The recursion of Kiefer and Wolfowitz: in order of arrival, each takes the server that is idle first."""
    rng = np.random.default_rng(workers)
    up, compute = rng.gamma(2, 0.02, (200, 3)), rng.gamma(3, 0.0016 * workers, (200, 3))
    served = edge(up, compute, 0.015, workers=workers, per_robot=False, discipline="fifo")
    tick = 0.015 * np.arange(200)[:, None]
    idle, expected = [0.0] * workers, np.zeros((200, 3))
    for k in sorted(np.ndindex(200, 3), key=lambda k: (tick + up)[k]):
        expected[k] = max(heapq.heappop(idle), (tick + up)[k])
        heapq.heappush(idle, expected[k] + compute[k])
    np.testing.assert_allclose(served.start, expected - tick, atol=1e-9)
    np.testing.assert_allclose(served.busy, compute.sum())


CARRIER = {"slot": 0.5e-3, "pattern": "DDDSU", "slot_bits": (20_000, 15_000)}

# robots, uplink bits, options; smallest, median, 95 %, largest; tick 0 robot 0, tick 0 last robot, last tick last robot
CELLS = [
    (2, 24_000, {}, (10.5, 11.75, 13.0, 13.0), (10.5, 13.0, 10.5)),
    (6, 24_000, {}, (10.5, 16.75, 25.5, 25.5), (10.5, 25.5, 20.5)),
    (6, 24_000, {"stagger": True}, (10.5, 18.0, 25.5, 25.5), (10.5, 25.5, 25.5)),
    (16, 8_000, {"access": 3e-3}, (10.5, 18.0, 25.5, 25.5), (10.5, 25.5, 23.0)),
    (8, 24_000, {}, (10.5, 1018, 1918, 2025.5), (10.5, 30.5, 2018)),
]


def spread(times: np.ndarray) -> list[float]:
    return [times.min(), np.median(times), np.percentile(times, 95), times.max()]


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("num_robots", "bits", "options", "expected", "single"), CELLS)
def test_check_values_of_the_cell(
    num_robots: int, bits: float, options: dict[str, Any], expected: tuple, single: tuple, exact: bool
) -> None:
    compute = np.full((500, num_robots), 5e-3)
    times = 1e3 * cell_loop(compute, 0.02, bits=(bits, 1200), exact=exact, **CARRIER, **options)
    np.testing.assert_allclose(spread(times), expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose([times[0, 0], times[0, -1], times[-1, -1]], single, rtol=0, atol=1e-6)


def test_check_values_of_the_whole() -> None:
    p, i = np.arange(500)[:, None], np.arange(4)[None, :]
    repeated = (1 + ((5 * p + 2 * i) % 10 == 0), 1 + ((3 * p + i) % 10 == 0))
    compute = (0.02 + 0.02 * ((7 * p + 3 * i) % 11)) / 4
    times = 1e3 * cell_loop(
        compute, 0.05, bits=(24_000, 1200), transmissions=repeated, core=1e-3, workers=2, per_robot=False,
        discipline="latest", exact=False, **CARRIER,
    )  # fmt: skip
    np.testing.assert_allclose(np.isinf(times).mean(), 0.1990, rtol=0, atol=5e-5)
    np.testing.assert_allclose(spread(times[np.isfinite(times)]), [12.5, 72.5, 102.5, 127.5], rtol=0, atol=1e-6)
    np.testing.assert_allclose(times[:4, 3], [87.5, 82.5, 62.5, 92.5], rtol=0, atol=1e-6)


def test_a_message_by_itself() -> None:
    """Ready at 1.1 ms: uplink slots begin at 2 and 4.5 ms, those down at 12.5, 13, 13.5, 15, 15.5, 16 and 17.5 ms."""
    compute, options = np.full((1, 1), 10e-3), CARRIER | {"access": 1.1e-3}
    assert cell_loop(compute, 1.0, bits=(20_000, 15_000), **options)[0, 0] == pytest.approx(13.0e-3)  # 2.5 12.5 13
    assert cell_loop(compute, 1.0, bits=(20_001, 45_001), **options)[0, 0] == pytest.approx(18.0e-3)  # 5 15 16.5 18
    # Two transmissions: 5 ms + 7.5, computed by 22.5, three times 15000 bits by 24, and two times 7.5.
    twice = cell_loop(compute, 1.0, bits=(20_000, 15_000), transmissions=(2, 3), **options)
    assert twice[0, 0] == pytest.approx(39e-3)
    # The core of the downlink delays the message after the air, that of the uplink before the edge.
    assert cell_loop(compute, 1.0, bits=(1, 1), core=1e-3, **options)[0, 0] == pytest.approx(15e-3)  # 3.5 13.5 14
    for lost in ((True, False), (False, True)):
        assert math.isinf(cell_loop(compute, 1.0, bits=(1, 1), lost=lost, **options)[0, 0])
    late = [cell_loop(compute, 1.0, bits=(1, 1), deadline=d, **options)[0, 0] for d in (12.4e-3, 12.5e-3)]
    assert late == [math.inf, pytest.approx(13e-3)]


def test_a_lost_message_has_used_the_air() -> None:
    lost = np.array([[True, False]])
    times = cell_loop(np.full((1, 2), 5e-3), 1.0, bits=(20_000, 1), lost=(lost, False), **CARRIER)
    np.testing.assert_allclose(times, [[np.inf, 10.5e-3]])


@pytest.mark.parametrize("seed", range(3))
def test_cumulated_bits(seed: int) -> None:
    """Y_k = max(C(n_k), Y_k-1) + b_k, on an uplink that other traffic takes at times; the downlink is next to free."""
    rng = np.random.default_rng(seed)
    num_ticks, num_robots, tau = 60, 3, 5e-3
    room = rng.integers(0, 20_000, 4000) * (rng.random(4000) < 0.7)
    bits = rng.integers(1, 6_000, (num_ticks, num_robots))
    compute = np.full((num_ticks, num_robots), 5e-3)
    carrier = {"slot": 0.5e-3, "pattern": "UD", "slot_bits": (room, 10**9)}
    times = cell_loop(compute, tau, bits=(bits, 1), **carrier)

    carried = np.r_[0, np.cumsum(room * (np.arange(4000) % 2 == 0))]  # C(n)
    level = 0
    for p in range(num_ticks):
        for i in sorted(range(num_robots), key=lambda i: (i - p) % num_robots):
            level = max(carried[10 * p], level) + bits[p, i]
            last = int(np.searchsorted(carried, level)) - 1
            # Even slots are the uplink's: the computation ends where an odd one begins.
            assert times[p, i] == pytest.approx((last + 12) * 0.5e-3 - p * tau, abs=1e-9)


def test_errors() -> None:
    compute = np.full((2, 1), 5e-3)
    options = {"workers": 1, "per_robot": True, "discipline": "skip"}
    for change, message in (({"discipline": "last"}, "discipline: got 'last'"), ({"workers": 0}, "workers: got 0")):
        with pytest.raises(ValueError, match=message):
            edge_loop(compute, compute, compute, 0.01, **options | change)
    for change, message in (
        ({"pattern": "DDS"}, "pattern: got 'DDS'"),
        ({"slot_bits": (0, 1)}, "slot_bits: got"),
        ({"slot_bits": (np.ones(20), 1)}, "the slots given end before 2 messages"),
    ):
        with pytest.raises(ValueError, match=message):
            cell_loop(compute, 0.01, bits=(1000, 1000), **CARRIER | change)
