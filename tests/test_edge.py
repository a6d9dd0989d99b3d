"""Finite edges: the scans against the edge event by event, the model's check values, queueing theory, and the loop."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import slow_dds
import slow_edge
from test_slow_edge import DEADLINE, EDGES, completed
from test_slow_loop import check_loop_times

from qocjax import Design, Rules, Scenario, evaluate, one_at_a_time, paper_network, replay, simulate
from qocjax.network import (
    Edge,
    EdgeNetwork,
    IndependentLoss,
    Load,
    LoopNetwork,
    Network,
    Trace,
    TruncatedNormal,
    loop_times,
    with_edge,
)
from qocjax.network.computing import computations_at_once
from qocjax.network.dds import DdsNetwork, Profile, Topic
from qocjax.network.edge import Served
from qocjax.network.estimate import usage
from qocjax.network.loop_network import Leg
from qocjax.study.chunks import Part, compute, plan
from qocjax.study.problem import Problem

TAU = 0.01
QUICKLY = {"xla_backend_optimization_level": 0}  # a program for few runs
PATIENCE = (0.03, 0.055, 1e3)  # deadlines (s)


@partial(jax.jit, static_argnames=("edge", "alike"), compiler_options=QUICKLY)
def serve(edge: Edge, uplink: Any, work: Any, tau: float, deadline: Any, alike: bool = False) -> Served:
    """The kernel."""
    return edge.serve(jnp.asarray(uplink), jnp.asarray(work), tau, deadline, alike)


def samples(kind: str, rng: np.random.Generator, edge: Edge, num_robots: int, ticks: int = 40) -> list[np.ndarray]:
    """Arrivals and times of computation [P, N] (s), of a load from light to twice what the edge can do."""
    shape = (ticks, num_robots)
    mean = rng.choice([0.5, 1.0, 2.0]) * TAU * edge.total(num_robots) / num_robots
    if kind == "continuous":  # out of order
        uplink, work = rng.gamma(1.5, 0.02, shape), rng.gamma(3, mean / 3, shape)
    else:
        uplink = np.full(shape, 0.003) if kind == "alike" else 0.005 * rng.integers(0, 6, shape)
        work = 0.005 * rng.integers(1, 2 + round(2 * mean / 0.005), shape)
    uplink[rng.random(shape) < 0.1] = np.inf
    return [np.round(uplink, 9), np.round(work, 9)]


def slow_served(edge: Edge, uplink: np.ndarray, work: np.ndarray, deadline: float) -> slow_edge.Served:
    return slow_edge.edge(
        uplink, work, TAU, workers=edge.workers, per_robot=edge.per_robot, discipline=edge.discipline,
        deadline=deadline if edge.abort else None,
    )  # fmt: skip


def is_quick(workers: int, per_robot: bool, abort: bool, num_robots: int, alike: bool) -> bool:
    """A part of all cases: shared workers each, own ones once."""
    choice = (5 if workers == 2 else 2, workers < 3, workers == 3)
    return (num_robots, abort, alike) == choice and (workers == 2 or not per_robot)


UNLIMITED = [pytest.param(Edge(abort=abort), 2, not abort) for abort in (True, False)]
CASES = UNLIMITED + [
    pytest.param(Edge(workers, per_robot, discipline, abort), num_robots, alike,
                 marks=() if is_quick(workers, per_robot, abort, num_robots, alike) else pytest.mark.slow)
    for discipline, workers, per_robot, abort, num_robots, alike in itertools.product(
        ("skip", "latest", "fifo"), (1, 2, 3), (True, False), (True, False), (1, 2, 5), (True, False))
]  # fmt: skip


@pytest.mark.parametrize(("edge", "num_robots", "alike"), CASES)
def test_is_the_slow_edge(edge: Edge, num_robots: int, alike: bool) -> None:
    """Sample for sample, a batch of deadlines and of arrivals of each kind."""
    rng = np.random.default_rng([edge.workers, num_robots, alike])
    loaded = edge if edge.finite else replace(edge, discipline="fifo")  # says how much work there is
    kinds = ["alike"] * 2 if alike else ["continuous", "continuous", "grid", "grid", "alike"]
    runs = [samples(kind, rng, loaded, num_robots) for kind in kinds]
    uplink, work = (np.stack(each, axis=-1)[:, :, None, :] for each in zip(*runs, strict=True))  # [P, N, 1, S]
    served = serve(edge, uplink, work, TAU, np.array(PATIENCE)[:, None], alike)
    found = [np.broadcast_to(part, (*uplink.shape[:2], len(PATIENCE), len(runs))) for part in served]
    for d, s in np.ndindex(len(PATIENCE), len(runs)):
        slow = slow_served(edge, *runs[s], PATIENCE[d])
        began, ended, busy = (part[:, :, d, s] for part in found)
        np.testing.assert_allclose(began, slow.start, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ended, slow.end, rtol=0, atol=1e-9)
        left = np.minimum(runs[s][1], PATIENCE[d] - slow.start if edge.abort else np.inf)
        np.testing.assert_allclose(busy, np.where(np.isfinite(slow.start), left, 0), rtol=0, atol=1e-9)
        assert busy.sum() == pytest.approx(slow.busy)


# The model prints other numbers for `latest`: there many computations in a row end on a tick, and those numbers rest on
# how float64 rounds the sum of their times. Here what falls on one instant does so exactly, as in the exact slow edge.
TIES = {
    2: (0.0373, 0.0460, (3.9214, 5.5109)),
    5: (0.0547, 0.0675, (4.0934, 4.2703)),
    6: (0.0523, 0.0523, (4.5853, 3.7773)),
}


@pytest.mark.parametrize("row", range(len(EDGES)))
def test_check_values(row: int) -> None:
    workers, per_robot, discipline, abort, share, finished, first, auc = EDGES[row]
    share, finished, auc = TIES.get(row, (share, finished, auc))
    work = check_loop_times(3000)
    served = serve(Edge(workers, per_robot, discipline, abort), np.zeros_like(work), work, TAU, DEADLINE, True)
    times = np.asarray(served.ended)
    np.testing.assert_allclose([completed(times), np.isfinite(times).mean()], [share, finished], rtol=0, atol=5.1e-5)
    if row not in TIES:
        ticks = np.flatnonzero(np.isfinite(times[:, 0]))[:3]
        assert ticks.tolist() == list(first)
        np.testing.assert_allclose(times[ticks, 0], list(first.values()), rtol=0, atol=1e-9)
    run = simulate(Scenario(start_jitter=(0.0, 0.0)), Design(deadline=DEADLINE, tau=TAU), times)
    np.testing.assert_allclose(run.auc, auc, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("discipline", ["skip", "latest", "fifo"])
def test_single_precision(discipline: str) -> None:
    """Ties are ties in float32 too, late in a run as well."""
    rng, edge = np.random.default_rng(5), Edge(2, False, discipline, abort=True)
    runs = [samples(kind, rng, edge, 3, ticks=2000) for kind in ("grid", "grid", "continuous")]
    uplink, work = (np.stack(each, axis=-1) for each in zip(*runs, strict=True))
    double = serve(edge, uplink, work, TAU, PATIENCE[1])
    single = serve(edge, *(values.astype(np.float32) for values in (uplink, work)), TAU, np.float32(PATIENCE[1]))
    assert single.ended.dtype == jnp.float32
    for name, one, other in zip(Served._fields, single, double, strict=True):
        same = np.isclose(one, other, rtol=1e-5, atol=2e-6)
        # What competes within a millionth of a second may be served the other way round.
        assert same[..., :2].all(), name
        assert same[..., 2].mean() > 0.999, name


def test_own_workers_are_edges_of_their_own() -> None:
    rng, edge = np.random.default_rng(6), Edge(1, True, "latest", abort=True)
    uplink, work = samples("continuous", rng, edge, 4)
    together = serve(edge, uplink, work, TAU, 0.1)
    alone = [
        serve(replace(edge, per_robot=False), uplink[:, i : i + 1], work[:, i : i + 1], TAU, 0.1) for i in range(4)
    ]
    for k, part in enumerate(together):
        np.testing.assert_allclose(part, np.concatenate([each[k] for each in alone], axis=1), rtol=0, atol=1e-12)


def test_work_that_takes_no_time_never_waits() -> None:
    rng, edge = np.random.default_rng(7), Edge(1, False, "latest")
    uplink, _ = samples("grid", rng, edge, 3)
    served = serve(edge, uplink, np.zeros_like(uplink), TAU, 0.0)
    np.testing.assert_array_equal(served.ended, uplink)


# Queueing theory. Arrivals are Poisson, one a second in the mean, whatever the ticks; each of many runs from an empty
# edge is one observation.
RUNS, ARRIVALS, EARLY = 48, 4000, 800


def poisson(edge: Edge, work: np.ndarray, seed: int) -> np.ndarray:
    """Waiting times (s) of all but the first arrivals, of the shape of `work`, [P, *B]; inf where dropped."""
    gaps = np.random.default_rng(seed).exponential(1.0, (len(work), 1, RUNS))
    uplink = (np.cumsum(gaps, axis=0) - np.arange(len(work))[:, None, None])[:, None]
    uplink += 1000.0  # a sample arrives after it was taken
    served = serve(edge, np.broadcast_to(uplink, (len(work), 1, *work.shape[1:])), work[:, None], 1.0, 0.0)
    return (np.asarray(served.began)[:, 0] - uplink[:, 0])[EARLY:]


def assert_within(values: np.ndarray, expected: np.ndarray, precision: float) -> None:
    """Means of runs [L, RUNS] within 4 standard errors, which are small enough to tell."""
    error = values.std(axis=1, ddof=1) / math.sqrt(RUNS)
    assert (error < precision * expected).all(), error / expected
    assert (np.abs(values.mean(axis=1) - expected) < 4 * error).all(), (values.mean(axis=1), expected, error)


def test_mean_wait_of_constant_work() -> None:
    """M/D/1: rho s / 2 (1 - rho)."""
    load = np.array([0.3, 0.6, 0.8])
    wait = poisson(Edge(1, True, "fifo"), np.broadcast_to(load[:, None], (ARRIVALS, 3, RUNS)), 1)
    assert_within(wait.mean(axis=0), load**2 / (2 * (1 - load)), 0.03)


def erlang_b(load: np.ndarray, workers: int) -> np.ndarray:
    lost = np.ones_like(load)
    for k in range(1, workers + 1):
        lost = load * lost / (k + load * lost)
    return lost


@pytest.mark.parametrize("workers", [1, 3])
def test_mean_wait_of_exponential_work(workers: int) -> None:
    """M/M/c: Erlang's C over c mu - lambda."""
    share = np.array([0.3, 0.6, 0.75])
    mean = share * workers  # s of work, at one arrival a second
    work = np.random.default_rng(2).exponential(mean[:, None], (ARRIVALS, 3, RUNS))
    lost = erlang_b(mean, workers)
    waits = lost / (1 - share * (1 - lost))
    assert_within(poisson(Edge(workers, False, "fifo"), work, 3).mean(axis=0), waits / (workers / mean - 1), 0.06)


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_loss_depends_on_the_mean_of_the_work_alone(workers: int) -> None:
    """Erlang's B at three loads, for work that is exponential, and for work that takes one time or nine times that."""
    mean = workers * np.array([0.4, 0.8, 1.5])
    rng = np.random.default_rng(4)
    shape = (ARRIVALS, 3, RUNS)
    law = {"exponential": rng.exponential(1.0, shape), "two": rng.choice([0.5, 4.5], shape, p=[0.875, 0.125])}
    work = np.concatenate([each * mean[:, None] for each in law.values()], axis=1)
    lost = np.isinf(poisson(Edge(workers, False, "skip"), work, 5)).mean(axis=0)
    assert_within(lost, np.tile(erlang_b(mean, workers), 2), 0.02)


# Networks behind an edge.
UP = Leg(TruncatedNormal(0.02, 0.02), IndependentLoss(0.05))
DOWN = Leg(TruncatedNormal(0.01, 0.005), IndependentLoss(0.05))
PATH = LoopNetwork(uplink=UP, compute=TruncatedNormal(0.1, 0.04), downlink=DOWN, name="path")
GIVES_UP = EdgeNetwork(PATH, Edge(1, True, "latest", abort=True))
SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=3.0)
LOAD = Load(60, 2, 0.05)
TOPIC = Topic(TruncatedNormal(0.02, 0.03), IndependentLoss(0.1), Profile(reliability="best_effort"), in_order=False)
TOPICS = DdsNetwork(uplink=TOPIC, compute=TruncatedNormal(0.05, 0.02), downlink=TOPIC)
KEYS = jax.random.split(jax.random.key(8), 6)


def contended(network: Any, deadlines: list[float], keys: jax.Array = KEYS, load: Load = LOAD) -> Any:
    """What becomes of the loops, and what chance decided."""
    at = jnp.asarray(deadlines)

    @partial(jax.jit, compiler_options=QUICKLY)
    def run(keys: jax.Array) -> Any:
        drawn = jax.vmap(lambda key: network.draw(key, *load))(keys)
        return network.contend(drawn, load.num_ticks, load.tau, at), drawn

    return jax.tree.map(np.asarray, run(keys))


@pytest.mark.parametrize("edge", [Edge(2, False, "latest", abort=True), Edge(1, True, "fifo")])
def test_a_loop_behind_an_edge_is_the_slow_one(edge: Edge) -> None:
    """[D, S, P, N] of all seeds and deadlines at once."""
    deadlines = [0.1, 0.2, 0.35]
    found, (up, work, down) = contended(EdgeNetwork(PATH, edge), deadlines)
    for d, s in np.ndindex(len(deadlines), len(KEYS)):
        slow = slow_edge.edge_loop(
            up[s], work[s], down[s], LOAD.tau, workers=edge.workers, per_robot=edge.per_robot,
            discipline=edge.discipline, deadline=deadlines[d] if edge.abort else None,
        )  # fmt: skip
        np.testing.assert_allclose(found.loop_times[d, s], slow, rtol=0, atol=1e-9)


def test_one_run_does_not_depend_on_the_others() -> None:
    times = contended(GIVES_UP, [0.1, 0.25])[0].loop_times[1]
    alone = [contended(GIVES_UP, [0.25], KEYS[k : k + 1])[0].loop_times[0, 0] for k in (0, 4)]
    np.testing.assert_allclose(alone, times[[0, 4]], rtol=0, atol=1e-12)


def test_chance_is_shared_by_all_deadlines() -> None:
    """What a deadline changes is who is served; T_UL, T_C and T_DL of a loop stay, so without a wait its time does."""
    edge = Edge(1, True, "skip", abort=True)
    found, drawn = contended(EdgeNetwork(PATH, edge), [0.1, 0.2, 0.4])
    times, plain = found.loop_times, sum(drawn)
    served = np.isfinite(times)
    assert not np.array_equal(served[0], served[1]) and not np.array_equal(served[1], served[2])
    np.testing.assert_allclose(np.where(served, times, plain), np.broadcast_to(plain, times.shape), atol=1e-12)


GRID = one_at_a_time(Design(tau=0.05), {"kappa": [1.0, 2.0]}, [0.15, 0.3]).designs


@pytest.mark.slow
def test_a_study_of_an_edge_that_gives_up() -> None:
    """Chunks are the study in one piece bit for bit, and its runs are those one by one."""
    problem, part = Problem(SCENARIO, GRID, GIVES_UP, Rules(), 3), Part("selection", range(64))
    (whole,) = plan(problem, part)
    chunks = plan(problem, part, chunk_steps=8000)
    assert len(chunks) == 4
    study = compute(problem, whole).values
    for chunk in chunks:
        found = compute(problem, chunk).values
        place = np.ix_(chunk.designs, range(*chunk.seeds))
        for name in study:
            np.testing.assert_array_equal(found[name], study[name][place], err_msg=name)
    for deadline in (0.15, 0.3):  # designs of one tau and deadline share their loops
        first, second = np.flatnonzero(GRID.deadline == deadline)
        for name in ("completed_share", "age_mean", "age_peak"):
            np.testing.assert_array_equal(study[name][first], study[name][second])
    for design, seed in ((0, 3), (2, 3), (3, 63)):
        one = Design(kappa=GRID.kappa[design], tau=0.05, deadline=GRID.deadline[design])
        run = replay(SCENARIO, one, GIVES_UP, seed, key=3)
        assert study["completed_share"][design, seed] == pytest.approx(float(run.completed_share), rel=1e-6)
        np.testing.assert_allclose(study["age_mean"][design, seed], run.age_mean, rtol=1e-5)
        np.testing.assert_allclose(study["auc"][design, seed], run.auc, rtol=1e-3)


def test_an_unlimited_edge_is_none() -> None:
    wrapped = EdgeNetwork(PATH, Edge(3, False))
    assert with_edge(PATH, wrapped.edge) is PATH
    plain = jax.jit(jax.vmap(lambda key: PATH.draw(key, *LOAD)), compiler_options=QUICKLY)(KEYS)
    np.testing.assert_allclose(
        contended(wrapped, [0.1])[0].loop_times[0], plain, rtol=0, atol=1e-7
    )  # draws are of 32 bits


def test_an_unlimited_edge_gives_up_too() -> None:
    network, deadlines = EdgeNetwork(PATH, Edge(abort=True)), [0.1, 0.2]
    assert network.uses_deadline
    found, (up, work, down) = contended(network, deadlines)
    ended = up + work
    expected = [np.where(ended <= deadline, ended + down, np.inf) for deadline in deadlines]
    np.testing.assert_allclose(found.loop_times, expected, rtol=0, atol=1e-12)


def test_topics_behind_an_edge_are_the_slow_ones() -> None:
    """BEST_EFFORT up, few workers, BEST_EFFORT down; a message that a newer one overtakes is lost."""
    network = with_edge(TOPICS, Edge(2, False, "latest"))
    ticks, robots, tau = 60, 3, 0.05
    found, drawn = contended(network, [0.1], jax.random.key(11)[None], Load(ticks, robots, tau))
    times, draws = found.loop_times[0, 0], jax.tree.map(lambda leaf: leaf[0], drawn)
    instants = np.arange(ticks) * tau

    def carried(draws: Any, robot: int, write: np.ndarray) -> np.ndarray:
        """Time until each message is handed over; numbers go by the order of writing."""
        order = np.argsort(write, kind="stable")

        def fate(kind: str, number: int, time: float) -> float | None:
            loop, tick = order[number], min(int(time / tau + 1e-3), ticks - 1)
            lost = draws.data.level[robot, loop] < draws.link.chance[robot, tick]
            return None if lost else float(draws.data.delay[robot, loop])

        handed = np.full(ticks, np.inf)
        for number, time in slow_dds.best_effort(write[order].tolist(), fate).items():
            handed[order[number]] = time
        return handed

    up = np.stack([carried(draws.uplink, i, instants) - instants for i in range(robots)], axis=1)
    served = slow_edge.edge(up, draws.compute.T, tau, workers=2, per_robot=False, discipline="latest")
    down = [carried(draws.downlink, i, instants + served.end[:, i]) - instants for i in range(robots)]
    assert np.isfinite(down).mean() > 0.3
    np.testing.assert_allclose(times, np.stack(down, axis=1), rtol=0, atol=1e-9)


# F, what is in use, and what of it is known exactly.
@pytest.mark.parametrize("edge", [Edge(1, True, "latest", abort=True), Edge(1, False, "skip")])
def test_reliability_is_what_completes(edge: Edge) -> None:
    """On other seeds, within the errors of both; and F with an edge is far from F without."""
    network, deadlines = EdgeNetwork(PATH, edge), [0.15, 0.3]
    load = Load(60, 2, 0.05)
    found = network.reliability(np.array(deadlines), load)
    runs = evaluate(SCENARIO, Design(tau=0.05, deadline=deadlines), network, range(64), key=1)
    shares = runs["completed_share"].values
    error = shares.std(axis=1, ddof=1) / 8
    assert (np.abs(found.share - shares.mean(axis=1)) < 4 * np.hypot(found.error, error)).all()
    assert ((0.002 < found.error) & (found.error < 0.02)).all()
    assert (found.share < PATH.reliability(np.array(deadlines), load).share - 0.1).all()


def test_reliability_of_a_plain_network_has_no_error() -> None:
    found = PATH.reliability([[0.1, 0.2]], LOAD)
    assert found.share.shape == (1, 2)
    np.testing.assert_array_equal(found.error, 0.0)


@pytest.mark.slow
def test_reliability_of_topics_depends_on_tau() -> None:
    """The closer messages follow each other, the more of them are overtaken; the laws of delay are the same."""
    fast, slow = (TOPICS.reliability(0.12, Load(200, 2, tau)) for tau in (0.01, 0.1))
    assert fast.share < slow.share - 10 * math.hypot(fast.error, slow.error)
    assert 0.0 < min(fast.error, slow.error) and max(fast.error, slow.error) < 0.01


@pytest.mark.parametrize("tau", [0.01, 0.1])
def test_computations_at_once_of_the_paper(tau: float) -> None:
    """N T_C / tau in the mean, but for the beginning of a run."""
    load = Load(round(10 / tau), 2, tau)
    found = computations_at_once(paper_network(), load)
    assert found is not None
    law = TruncatedNormal(0.2, 0.05)
    mean = law.quantile((np.arange(2000) + 0.5) / 2000).mean()
    at_end = np.minimum(mean, 10 - np.arange(load.num_ticks) * tau)  # close to E min(T_C, what is left)
    assert found.mean == pytest.approx(2 * at_end.sum() / 10, rel=1e-2)
    assert mean * 2 / tau < found.peak < 1.5 * mean * 2 / tau + 2


@pytest.mark.parametrize(("edge", "total"), [(Edge(1, True, "skip"), 2), (Edge(3, False, "latest", abort=True), 3)])
def test_computations_at_once_of_few_workers(edge: Edge, total: int) -> None:
    network = with_edge(paper_network(), edge)
    found = computations_at_once(network, Load(200, 2, 0.02), 0.3)
    assert found is not None and found.peak == total and 0.8 * total < found.mean <= total
    share, _ = usage(network, 0.3, Load(200, 2, 0.02))["edge"]
    assert share == pytest.approx(found.mean / total, rel=1e-6)


@pytest.mark.parametrize(
    ("make", "kind", "message"),
    [
        (lambda: Edge(0), ValueError, r"Edge\.workers: got 0, expected .*1"),
        (lambda: Edge(1, True, "lifo"), ValueError, r"Edge\.discipline: got 'lifo', expected .*unlimited.*fifo"),
        (lambda: Edge(per_robot=1), TypeError, r"Edge\.per_robot: got 1, expected True or False"),
        (lambda: EdgeNetwork(Trace([0.1], "t"), Edge()), TypeError, r"EdgeNetwork\.path: got Trace.*, expected a net"),
        (lambda: with_edge(Trace([0.1], "t"), Edge(1, True, "skip")), TypeError, r"EdgeNetwork\.path: got Trace"),
        (lambda: EdgeNetwork(PATH, "skip"), TypeError, r"EdgeNetwork\.edge: got 'skip', expected an Edge"),
        (lambda: loop_times(GIVES_UP, KEYS, *LOAD), ValueError, r"deadline: got None for 'path'.*, expected s"),
        (lambda: GIVES_UP.reliability(np.nan, LOAD), ValueError, r"deadline: got NaN, expected numbers"),
    ],
)
def test_errors(make: Any, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_networks_of_one_kind_are_one_network() -> None:
    """Hashable, so that programs are shared, and written with results."""
    same: list[Network] = [with_edge(PATH, Edge(1, True, "skip")) for _ in range(2)]
    assert same[0] == same[1] and hash(same[0]) == hash(same[1])
    assert same[0].describe()["edge"] == {
        "kind": "Edge", "workers": 1, "per_robot": True, "discipline": "skip", "abort": False,
    }  # fmt: skip
