"""A shared cell: the running maximum against slots one by one, the model's check values, and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import slow_cell
import slow_edge
from test_slow_edge import CELLS, spread

from qocjax.network import Constant, Edge, Load, TruncatedNormal
from qocjax.network.cell import Access, CellNetwork, Direction, Frame, OtherTraffic
from qocjax.network.cell.air import through_air
from qocjax.network.cell.cell_network import Chances
from qocjax.network.cell.traffic import Capacity
from qocjax.network.estimate import usage
from qocjax.network.interface import Contended

QUICKLY = {"xla_backend_optimization_level": 0}  # a program for few runs


@partial(jax.jit, static_argnames=("network", "num_ticks", "num_robots", "tau"), compiler_options=QUICKLY)
def draw(network: CellNetwork, keys: jax.Array, num_ticks: int, num_robots: int, tau: float) -> Chances:
    return jax.vmap(lambda key: network.draw(key, num_ticks, num_robots, tau))(keys)


@partial(jax.jit, static_argnames="network", compiler_options=QUICKLY)
def contend(network: CellNetwork, drawn: Chances, num_ticks: int, tau: float, deadlines: jax.Array) -> Contended:
    return network.contend(drawn, num_ticks, tau, deadlines)


def given(compute: Any, up: Any = 0, down: Any = 0) -> Chances:
    """One seed with these times of computation (s) and failed transmissions, without bursts; [1, P, N]."""
    work = jnp.asarray(compute, float)[None]
    failed = [jnp.broadcast_to(jnp.asarray(each, float), work.shape) for each in (up, down)]
    none = jnp.zeros((1, 0), bool)
    return Chances(work, jnp.zeros_like(work), (failed[0], none), (failed[1], none))


def cell(up_bits: float, down_bits: float, **options: Any) -> CellNetwork:
    """The cell of the check values."""
    return CellNetwork(uplink=Direction(up_bits / 8, 20_000), downlink=Direction(down_bits / 8, 15_000), **options)


OPTIONS: dict[str, Any] = {
    "access": lambda seconds: ("access", Access(grant=seconds)),
    "stagger": lambda on: ("stagger", on),
}


@pytest.mark.parametrize(("num_robots", "bits", "options", "expected", "single"), CELLS)
def test_check_values(num_robots: int, bits: float, options: dict[str, Any], expected: tuple, single: tuple) -> None:
    network = cell(bits, 1200, **dict(OPTIONS[name](value) for name, value in options.items()))
    drawn = given(np.full((500, num_robots), 5e-3))
    times = 1e3 * np.asarray(contend(network, drawn, 500, 0.02, jnp.zeros(1)).loop_times[0, 0])
    np.testing.assert_allclose(spread(times), expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose([times[0, 0], times[0, -1], times[-1, -1]], single, rtol=0, atol=1e-6)


def test_check_values_of_the_whole() -> None:
    """The model's own numbers rest on how float64 rounds sums of times at ties; these are exact."""
    p, i = np.arange(500)[:, None], np.arange(4)[None, :]
    up, down = (5 * p + 2 * i) % 10 == 0, (3 * p + i) % 10 == 0
    compute = (0.02 + 0.02 * ((7 * p + 3 * i) % 11)) / 4
    network = cell(24_000, 1200, core=1e-3, edge=Edge(2, False, "latest"))
    found = np.asarray(contend(network, given(compute, up, down), 500, 0.05, jnp.zeros(1)).loop_times[0, 0])
    slow = slow_cell.cell_loop(
        compute, 0.05, slot=0.5e-3, pattern="DDDSU", slot_bits=(20_000, 15_000), bits=(24_000, 1200),
        transmissions=(1 + up, 1 + down), core=1e-3, workers=2, per_robot=False, discipline="latest",
    )  # fmt: skip
    np.testing.assert_allclose(found, slow, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.isinf(found).mean(), 0.1950, rtol=0, atol=5e-5)
    np.testing.assert_allclose(spread(1e3 * found[np.isfinite(found)]), [22.5, 72.5, 107.5, 127.5], rtol=0, atol=1e-6)


def slow_loops(network: CellNetwork, drawn: Chances, tau: float, deadline: float) -> np.ndarray:
    """Loop times [P, N] of what chance decided for one seed."""
    compute = np.asarray(drawn.compute)
    ticks, robots = compute.shape
    tick = np.arange(ticks)[:, None] * np.full((1, robots), tau)

    def cross(way: str, letter: str, ready: np.ndarray, chance: tuple) -> np.ndarray:
        direction, failures = getattr(network, way), np.asarray(chance[0])
        sent = np.minimum(failures + 1, network.harq_max)
        bursts = np.resize(chance[1], 60_000) if len(chance[1]) else np.zeros(60_000)
        room = direction.slot_bits * (1 - direction.other.share - direction.other.burst_share * bursts)
        pattern = network.frame.pattern.replace("B", letter)
        slots = slow_cell.slots(letter, pattern, room)
        leaves = slow_cell.air(ready, sent * 8 * direction.message_bytes, slots, network.frame.slot)
        arrives = leaves + (sent - 1) * network.harq_rtt + network.core
        return np.where(failures < network.harq_max, arrives, np.inf)

    ready = tick + np.asarray(drawn.request) * network.access.request_period + network.access.grant
    if network.stagger:
        ready = ready + np.arange(robots) * tau / robots
    up = cross("uplink", "U", ready, drawn.uplink) - tick
    edge = network.edge
    served = slow_edge.edge(
        up, compute, tau, workers=edge.workers, per_robot=edge.per_robot, discipline=edge.discipline,
        deadline=deadline if network.uses_deadline else None,
    )  # fmt: skip
    return cross("downlink", "D", tick + served.end, drawn.downlink) - tick


BURSTS = OtherTraffic(0.1, 0.7, 0.05, 0.3)
WORK = TruncatedNormal(0.03, 0.015)
RANDOM = {
    "HARQ and losses": (3, 0.02, CellNetwork(
        uplink=Direction(1000, 20_000, 0.3), downlink=Direction(150, 15_000, 0.2), compute=WORK, harq_max=2,
        core=1e-3, edge=Edge(abort=True))),
    "request, staggered, FDD, few workers": (4, 0.02, CellNetwork(
        uplink=Direction(2000, 9000, 0.1), downlink=Direction(300, 6000, 0.1), compute=WORK, frame=Frame("B", 1e-3),
        access=Access(5e-3, 3e-3), stagger=True, harq_rtt=8e-3, edge=Edge(2, False, "latest", abort=True))),
    "bursts": (2, 0.025, CellNetwork(
        uplink=Direction(1500, 20_000, 0.1, BURSTS), downlink=Direction(1500, 15_000, 0.0, replace(BURSTS, share=0.0)),
        compute=Constant(0.01), edge=Edge(1, True, "skip"))),
    "overload that bursts make": (6, 0.02, CellNetwork(
        uplink=Direction(1500, 20_000, 0.0, OtherTraffic(0.0, 1.0, 0.02, 0.5)), downlink=Direction(150, 15_000),
        compute=Constant(0.005), frame=Frame("DSUUD"), edge=Edge(4, False, "fifo"))),
    "tau that no slot divides": (5, 1 / 64 + 1e-4, CellNetwork(
        uplink=Direction(1000, 20_000, 0.05), downlink=Direction(4000, 15_000, 0.05), compute=WORK,
        frame=Frame("DDDDDDDSUU", 0.25e-3), core=0.7e-3, edge=Edge(3, True, "latest"))),
    "a message of many slots": (1, 0.1, CellNetwork(
        uplink=Direction(12_500, 20_000, 0.5), downlink=Direction(1e-3, 15_000), compute=Constant(0.0), harq_max=3,
        stagger=True)),
}  # fmt: skip


@pytest.mark.parametrize("name", RANDOM)
def test_is_the_slow_cell(name: str) -> None:
    num_robots, tau, network = RANDOM[name]
    tau, deadlines = round(tau, 9), [0.05, 0.12]
    drawn = draw(network, jax.random.split(jax.random.key(4), 3), 60, num_robots, tau)
    found = contend(network, drawn, 60, tau, jnp.asarray(deadlines)).loop_times
    for d, s in np.ndindex(2, 3):
        slow = slow_loops(network, jax.tree.map(lambda leaf, s=s: np.asarray(leaf[s]), drawn), tau, deadlines[d])
        np.testing.assert_allclose(found[d, s], slow, rtol=0, atol=1e-9)
    assert np.isfinite(found).mean() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_is_the_slow_cell_for_any_settings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    num_robots, tau = int(rng.integers(1, 7)), round(float(rng.choice([0.01, 0.02, 0.0333, rng.uniform(0.01, 0.1)])), 6)
    frame = Frame(str(rng.choice(["DDDSU", "DSU", "B", "DDSUU", "UD"])), float(rng.choice([0.25e-3, 0.5e-3, 1e-3])))

    def direction(way: str) -> Direction:
        other = OtherTraffic(*rng.choice([(0.0, 0.0, 0.1, 0.0), (0.2, 0.0, 0.1, 0.0), (0.1, 0.9, 0.03, 0.3)]))
        bits = rng.choice([0.2, 0.5, 0.9]) * tau / num_robots / frame.slot * frame.share(way) * 16_000
        return Direction(max(1.0, round(bits * (1 - other.mean_share) / 8)), 16_000, rng.choice([0.0, 0.1, 0.4]), other)

    network = CellNetwork(
        uplink=direction("uplink"), downlink=direction("downlink"), frame=frame, compute=WORK,
        access=Access(*rng.choice([(0.0, 0.0), (0.0, 2e-3), (5e-3, 3e-3)])), stagger=bool(rng.random() < 0.5),
        harq_max=int(rng.integers(1, 4)), core=float(rng.choice([0.0, 1e-3])),
        edge=Edge(int(rng.integers(1, 4)), bool(rng.random() < 0.5),
                  str(rng.choice(["unlimited", "skip", "latest", "fifo"])), bool(rng.random() < 0.5)),
    )  # fmt: skip
    drawn = draw(network, jax.random.key(seed)[None], 60, num_robots, tau)
    found = contend(network, drawn, 60, tau, jnp.asarray([0.08])).loop_times[0, 0]
    one = jax.tree.map(lambda leaf: np.asarray(leaf[0]), drawn)
    np.testing.assert_allclose(found, slow_loops(network, one, tau, 0.08), rtol=0, atol=1e-9)


@pytest.mark.parametrize("tau", [0.02, pytest.param(0.032, marks=pytest.mark.slow)])
def test_single_precision(tau: float) -> None:
    """Late in an overloaded run, and near full load with repetitions; robots that all send at the same instant."""
    network = replace(cell(24_000, 1200, edge=Edge(2, True, "latest")), uplink=Direction(3000, 20_000, 0.1))
    drawn = draw(network, jax.random.key(1)[None], 1000, 8, tau)
    narrow = jax.tree.map(lambda leaf: leaf.astype(jnp.float32) if leaf.dtype == jnp.float64 else leaf, drawn)
    double, single = (
        np.asarray(contend(network, each, 1000, tau, jnp.zeros(1, each.compute.dtype)).loop_times)
        for each in (drawn, narrow)
    )
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, double, rtol=2e-6, atol=2e-6)


def frame_gaps(frame: Frame) -> np.ndarray:
    """Times between the beginnings of uplink slots (s), round the pattern."""
    begins = np.flatnonzero([letter in "UB" for letter in frame.pattern]) * frame.slot
    return np.diff(begins, append=begins[0] + len(frame.pattern) * frame.slot)


@pytest.mark.parametrize("frame", [Frame(), Frame("DDSUU"), Frame("B", 1e-3), Frame("DDDDDDDSUU", 0.25e-3)])
def test_alignment(frame: Frame) -> None:
    """Without load the wait is that of an instant at random for the next slot: P(wait <= w) = sum min(w, g) / sum g."""
    gaps = frame_gaps(frame)
    period, ticks = gaps.sum(), 5000
    tau = (7 + (math.sqrt(5) - 1) / 2) * period  # instants that fill the pattern evenly
    capacity = Capacity(jnp.asarray(1.0), jnp.asarray(0.0), None)
    ready, size = jnp.zeros((ticks, 1)), jnp.full((ticks, 1), 0.01)
    delay = np.asarray(through_air(ready, size, tau, frame, "uplink", capacity, alike=True))[:, 0]
    assert delay.mean() == pytest.approx(frame.slot + (gaps**2).sum() / (2 * period), abs=1e-3 * period)
    wait = np.linspace(0, gaps.max(), 9)
    expected = np.minimum(wait[:, None], gaps).sum(axis=1) / period
    found = np.mean(delay[None] - frame.slot <= wait[:, None] + 1e-12, axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-3)


@pytest.mark.parametrize(("length", "share"), [(0.05, 0.3), (0.01, 0.7)])
def test_other_traffic(length: float, share: float) -> None:
    """On and off as a Markov chain seen once a slot: stationary from the first slot on, runs of the right length."""
    traffic, frame = OtherTraffic(0.1, 0.5, length, share), Frame("B", 2e-3)
    assert traffic.mean_share == pytest.approx(0.1 + 0.5 * share)
    draws = jax.jit(jax.vmap(lambda key: traffic.draw(key, frame, 8.0)))
    on = np.asarray(draws(jax.random.split(jax.random.key(2), 400)))
    assert on.shape == (400, 4000)

    def within(values: np.ndarray, expected: float, precision: float) -> None:
        error = values.std(ddof=1) / math.sqrt(len(values))
        assert error < precision * expected
        assert abs(values.mean() - expected) < 4 * error

    within(on.mean(axis=1), share, 0.02)
    for slot in (0, 1, 1999, 3999):
        within(on[:, slot].astype(float), share, 0.15)
    rate = 1 / length + share / (length * (1 - share))  # of forgetting (1/s)
    stays = share + (1 - share) * math.exp(-rate * frame.slot)
    ends = on[:, :-1] & ~on[:, 1:]
    runs = on[:, :-1].sum(axis=1) / ends.sum(axis=1)
    within(1 / runs, 1 - stays, 0.02)


@pytest.mark.parametrize(
    "other", [pytest.param(OtherTraffic(0.2), marks=pytest.mark.slow), OtherTraffic(0.1, 0.8, 0.02, 0.25)]
)
def test_utilisation_is_the_offered_load(other: OtherTraffic) -> None:
    """Others and all transmissions; next to nothing is left under way when a run ends. Above, the air is full."""
    frame, harq_max, bler = Frame(), 3, 0.2
    for load in (0.2, 0.5, 2.0):
        bits = 4 * (1 + bler + bler**2) / 0.02  # a second, for messages of one bit
        slot_bits = bits * 10_000 / (load * frame.share("uplink") / frame.slot)
        network = CellNetwork(
            uplink=Direction(1250, slot_bits, bler, other), downlink=Direction(100, 1e6), harq_max=harq_max
        )  # fmt: skip
        used, error = usage(network, 0.1, Load(500, 4, 0.02))["uplink"]
        expected = min(other.mean_share + load, 1.0)
        assert error < 0.03
        assert abs(used - expected) < 4 * error + 0.012


def two_ways(**changed: Any) -> dict[str, Any]:
    return {"uplink": Direction(3000, 20_000), "downlink": Direction(150, 15_000)} | changed


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CellNetwork(**two_ways(uplink=Direction(2e6, 20_000))),
         r"CellNetwork\.uplink\.message_bytes: got 2e\+06, expected at most 1000000, what a second carries"),
        (lambda: CellNetwork(**two_ways(downlink=Direction(2e6, 20_000, 0.0, OtherTraffic(0.5)))),
         r"CellNetwork\.downlink\.message_bytes: got 2e\+06, expected at most 1500000"),
        (lambda: Frame("DDDS"), r"Frame\.pattern: got 'DDDS' without a slot of the uplink, expected .* U or B"),
        (lambda: Frame("UUS"), r"Frame\.pattern: got 'UUS' without a slot of the downlink"),
        (lambda: Frame("DXU"), r"Frame\.pattern: got 'DXU', expected letters"),
        (lambda: Frame(""), r"Frame\.pattern: got ''"),
        (lambda: Frame(slot=0.0), r"Frame\.slot: got 0"),
        (lambda: OtherTraffic(0.5, 0.6), r"OtherTraffic: got share 0\.5 and burst_share 0\.6"),
        (lambda: OtherTraffic(0.1, 0.5, 0.1, 1.0), r"OtherTraffic\.burst_time: got 1"),
        (lambda: CellNetwork(**two_ways(), harq_max=0), r"CellNetwork\.harq_max: got 0"),
        (lambda: Direction(100, 1000, 1.5), r"Direction\.bler: got 1\.5"),
        (lambda: Access(-1e-3), r"Access\.request_period: got -0\.001"),
    ],
)  # fmt: skip
def test_errors(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
