"""Completion, age and order of commands against events handled one by one; the splitting of deadlines; relations."""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import MODES

from qocjax.network.schedule import ACTUATIONS, Rules, Schedule, schedule, split_deadline

P, N = 40, 3


@partial(jax.jit, static_argnames="rules")
def scheduled(times: jax.Array, deadline: jax.Array, tau: jax.Array, rules: Rules) -> Schedule:
    _, rest = split_deadline(deadline, tau)
    return schedule(times, deadline, tau, rules, (rest > 0) & (rules.actuation == "deadline"))


def by_events(times: np.ndarray, deadline: float, tau: float, actuation: str) -> tuple[np.ndarray, np.ndarray]:
    """Age at each tick, in ticks, and the loop whose command is in force at the end of the tick; (model, section 4)."""
    age, source = np.zeros(times.shape, int), np.full(times.shape, -1)
    for robot in range(times.shape[1]):
        effects = []  # (time in ticks, loop)
        for p, time in enumerate(times[:, robot]):
            if time > deadline * (1 + 1e-9):
                continue
            wait = {"deadline": deadline, "arrival": time, "instant": 0.0}[actuation] / tau
            wait = round(wait) if abs(wait - round(wait)) < 1e-6 else wait
            effects.append((p + (math.ceil(wait) if actuation == "arrival" else wait), p))
        for p in range(len(times)):
            # What a loop itself brings at its own instant comes after the controller has sampled.
            seen = [loop for at, loop in effects if at <= p and loop < p]
            age[p, robot] = p - max(seen, default=0)
            source[p, robot] = max((loop for at, loop in effects if at < p + 1), default=-1)
    return age, source


def random_times(rng: np.random.Generator, tau: float, deadline: float) -> np.ndarray:
    times = rng.uniform(0.0, 1.5 * deadline + tau, (P, N))
    times = np.where(rng.random((P, N)) < 0.3, np.round(times / tau) * tau, times)  # some exactly at instants
    return np.where(rng.random((P, N)) < 0.3, np.inf, times)


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
@pytest.mark.parametrize("actuation", ACTUATIONS)
def test_age_and_source_are_those_of_the_events(actuation: str, dtype: jnp.dtype) -> None:
    rng = np.random.default_rng(5)
    for tau in (0.01, 0.05, 0.3):
        for ratio in (0.0, 0.4, 1.0, 3.0, 4.5, 7.0, 12.3, 45.0):
            deadline = round(ratio * tau, 6)
            times = random_times(rng, tau, deadline)
            network = scheduled(*(jnp.asarray(v, dtype) for v in (times, deadline, tau)), Rules(actuation))
            age, source = by_events(times, deadline, tau, actuation)
            np.testing.assert_allclose(network.age, age * tau, rtol=1e-6, err_msg=f"{tau} {ratio}")
            np.testing.assert_array_equal(network.source, source)
            np.testing.assert_array_equal(network.fresh, np.diff(source, axis=0, prepend=-1) > 0)
            assert network.age.dtype == dtype


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_multiple_of_tau_is_one_in_any_precision(dtype: type) -> None:
    """As numbers are written by hand, by linspace, and as products."""
    split = jax.jit(split_deadline)
    for tau in (0.001, 0.005, 0.01, 0.02, 0.025, 0.03, 0.05, 0.1, 0.2):
        k = np.arange(0, 801)
        for deadline in (k * tau, np.round(k * tau, 6), np.linspace(0, 800 * tau, 801)):
            lag, rest = split(deadline.astype(dtype), dtype(tau))
            np.testing.assert_array_equal(lag, k)
            np.testing.assert_array_equal(rest, 0)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_rest_of_other_deadlines(dtype: type) -> None:
    rng = np.random.default_rng(0)
    for tau in (0.01, 0.05, 0.2):
        k, part = rng.integers(0, 80, 500), rng.uniform(0.01, 0.99, 500)
        lag, rest = split_deadline(((k + part) * tau).astype(dtype), dtype(tau))
        np.testing.assert_array_equal(lag, k)
        np.testing.assert_allclose(rest, part * tau, atol=1e-12 if dtype == np.float64 else 2e-6)


@pytest.mark.parametrize("deadline", [0.05, 0.1, 0.17, 0.3, 0.42])
def test_age_keeps_within_a_tick_above_the_deadline_when_all_loops_complete(deadline: float) -> None:
    tau = 0.1
    times = np.random.default_rng(1).uniform(0, deadline, (P, N))
    age = np.asarray(scheduled(times, deadline, tau, Rules()).age)[math.ceil(deadline / tau - 1e-9) + 1 :]
    assert age.min() >= deadline - 1e-12 and age.max() < deadline + tau - 1e-12


def test_losses_only_make_commands_older_and_deadlines_only_complete_more() -> None:
    rng, tau = np.random.default_rng(2), 0.1
    times = rng.gamma(3.0, 0.1, (P, N))
    fewer = np.where(rng.random((P, N)) < 0.3, np.inf, times)
    for actuation in ACTUATIONS:
        for deadline in (0.0, 0.2, 0.35):
            runs = [scheduled(t, deadline, tau, Rules(actuation)) for t in (times, fewer)]
            assert np.all(runs[1].age >= runs[0].age) and np.all(runs[1].source <= runs[0].source)
    arrival = [scheduled(times, limit, tau, Rules(a)) for limit in (0.2, 0.35, 0.5) for a in ("arrival", "deadline")]
    assert all(np.all(arrival[k].age <= arrival[k + 1].age) for k in (0, 2, 4))  # arriving early is no harm
    shares = [float(run.completed.mean()) for run in arrival[::2]]
    assert shares == sorted(shares) and shares[0] < shares[-1]


@pytest.mark.parametrize("mode", MODES, ids=["-".join(mode) for mode in MODES])
def test_gains_lie_between_stop_and_go(mode: tuple[str, str]) -> None:
    rng, tau = np.random.default_rng(3), 0.1
    for deadline in (0.0, 0.2, 0.25):
        times = random_times(rng, tau, deadline)
        network = scheduled(times, deadline, tau, Rules(*mode, hold_timeout=0.35, hold_decay=0.4))
        if mode[1] == "hold":
            assert network.gain_start is None and network.gain_mid is None
            continue
        gains = np.stack([network.gain_start, network.gain_mid])
        assert gains.min() >= 0 and gains.max() == 1
        assert mode[1] == "decay" or set(np.unique(gains)) <= {0.0, 1.0}
        assert np.all(gains[1][np.asarray(network.fresh)] == 1) or mode[1] != "zero"
