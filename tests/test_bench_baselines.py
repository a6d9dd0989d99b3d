"""The baselines of the benchmark suite compute what the model says, and the same as each other."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from slow_loop import run as run_slow_loop

from experiments.bench.baselines import Unavailable, Work, make_work, reference_path
from experiments.bench.baselines.work import DESIGN
from experiments.bench.mppi import scene
from experiments.bench.study import NETWORK, Study, work_of
from experiments.bench.timing import machine, measure
from qocjax import Design, Scenario, evaluate
from qocjax.navigation import MapCosts, MppiConfig, initial_state, step
from qocjax.navigation.noise import seed_of

BASELINES = ("numpy_loop", "vmap_scan", "numba_loop", "cpp_kernel", "cpp_metrics")
LANE_FIELDS = (*DESIGN, "deadline", "seed")

# Model, section 11, the rows with actuation `deadline`: deadline (s), tau (s), eta, AUC of the two robots (s).
CHECKS = (
    (0.160, 0.01, 0.6, (3.1928, 3.2431)),
    (0.200, 0.01, 0.6, (3.1964, 3.3781)),
    (0.325, 0.01, 0.6, (3.8164, 3.9099)),
    (0.500, 0.01, 0.0, (3.1201, 3.1924)),
    (0.050, 0.01, 0.6, (215.9368, 215.9368)),
    (0.250, 0.05, 0.6, (3.3974, 4.0123)),
)


def run(name: str, work: Work) -> np.ndarray:
    """AUC by the named baseline; skips where its compiler is missing."""
    try:
        auc = importlib.import_module(f"experiments.bench.baselines.{name}").evaluate(work)
    except Unavailable as reason:
        pytest.skip(str(reason))
    assert auc.shape == (work.num_lanes, work.num_robots) and auc.dtype == np.float32
    return auc


def check_work(tau: float) -> tuple[Work, np.ndarray]:
    """The check cases of one tau, a lane each, and their AUC."""
    rows = [row for row in CHECKS if row[1] == tau]
    design: dict[str, Any] = {name: np.full(len(rows), value) for name, value in DESIGN.items()}
    design["eta"] = np.array([row[2] for row in rows])
    p, i = np.arange(round(30 / tau))[:, None], np.arange(2)
    work = Work(
        **design,
        deadline=np.array([row[0] for row in rows]),
        seed=np.zeros(len(rows)),
        loop_times=0.121 + 0.02 * ((7 * p + 3 * i) % 11)[None],
        start=np.array([[[-2, -1.5, 0.3], [-2, 1.5, 0]]]),
        tau=tau,
    )
    return work, np.array([row[3] for row in rows])


@pytest.mark.parametrize("tau", [0.01, 0.05])
@pytest.mark.parametrize("name", BASELINES)
def test_check_values(name: str, tau: float) -> None:
    work, expected = check_work(tau)
    np.testing.assert_allclose(run(name, work), expected, rtol=0.02)


@pytest.fixture(scope="module", params=[2, 3])
def mixed(request: pytest.FixtureRequest) -> tuple[Work, np.ndarray]:
    """Deadlines of 0, inside a tick, on the grid and past the horizon, lost loops, lanes in no order; AUC by NumPy.

    A short horizon: before the robots meet, rounding is not amplified and the baselines must agree closely.
    """
    tidy = make_work(4, 5, [0.0, 0.004, 0.02, 0.137, 0.24, 9.0], 0.02, horizon=2.0, num_robots=request.param)
    rng = np.random.default_rng(1)
    kind = rng.random(tidy.loop_times.shape)
    times = np.where(kind < 0.2, np.inf, np.where(kind > 0.7, 0.0, 0.5 * tidy.loop_times))
    order = rng.permutation(tidy.num_lanes)[:-3]  # and no multiple of a vector's width
    lanes = {name: getattr(tidy, name)[order] for name in LANE_FIELDS}
    work = replace(tidy, **lanes, loop_times=times, weights=(1.0, 2.5))
    return work, run("numpy_loop", work)


@pytest.mark.parametrize("name", BASELINES[1:])
def test_baselines_agree(name: str, mixed: tuple[Work, np.ndarray]) -> None:
    work, expected = mixed
    np.testing.assert_allclose(run(name, work), expected, rtol=5e-4)


def test_agrees_with_the_slow_loop(mixed: tuple[Work, np.ndarray]) -> None:
    work, auc = mixed
    for k in [np.flatnonzero(work.deadline == deadline)[0] for deadline in np.unique(work.deadline)]:
        design = {name: float(getattr(work, name)[k]) for name in (*DESIGN, "deadline")} | {"tau": work.tau}
        start, times = work.start[work.seed[k]].tolist(), work.loop_times[work.seed[k]]
        slow = run_slow_loop(start, work.goal, work.horizon, design, times, weights=work.weights)
        np.testing.assert_allclose(auc[k], slow["auc"], rtol=1e-3)


def test_change_splits_deadlines() -> None:
    work = make_work(1, 1, [0.0, 0.004, 0.01, 0.16, 0.325], horizon=1.0)
    lag, rest = work.change
    assert lag.tolist() == [0, 0, 0, 15, 32]
    np.testing.assert_allclose(rest, [0.0, 0.004, 0.01, 0.01, 0.005], atol=1e-7)


def test_reference_is_straight_then_exponential() -> None:
    work, _ = check_work(0.01)
    path = reference_path(work)[0]
    knee = (4 - 0.35) / 0.7
    np.testing.assert_allclose(path[100], (-2 + 0.7, 0), atol=1e-6)
    np.testing.assert_allclose(path[600], (2 - 0.35 * np.exp(-2 * (6 - knee)), 0), atol=1e-6)


def test_same_arguments_give_the_same_work() -> None:
    a, b = (make_work(2, 3, [0.2], horizon=1.0, random_seed=7) for _ in range(2))
    assert all(np.array_equal(getattr(a, name), getattr(b, name)) for name in (*LANE_FIELDS, "loop_times", "start"))
    assert not np.array_equal(a.kappa, make_work(2, 3, [0.2], horizon=1.0, random_seed=8).kappa)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seed", np.array([9, 9])),
        ("deadline", np.array([-0.1, 0.2])),
        ("kappa", np.ones(3)),
        ("horizon", 0.123),
        ("loop_times", np.full((1, 100, 2), -1.0)),
        ("start", np.zeros((1, 2, 3))),
    ],
)
def test_bad_work_is_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"Work.{name}"):
        replace(make_work(2, 1, [0.2], horizon=1.0), **{name: value})


def test_cpp_refuses_turns_past_its_series() -> None:
    work = make_work(1, 1, [0.4], 0.4, horizon=2.0)
    with pytest.raises(ValueError, match="omega_max"):
        importlib.import_module("experiments.bench.baselines.cpp_kernel").evaluate(work)


def test_cpp_without_compiler_is_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = importlib.import_module("experiments.bench.baselines.cpp_kernel")
    monkeypatch.setenv("PATH", "")
    kernel._compiled.cache_clear()
    with pytest.raises(Unavailable, match="g\\+\\+"):
        kernel.evaluate(make_work(1, 1, [0.2], horizon=1.0))


def test_measure_and_machine() -> None:
    calls: list[int] = []
    timing = measure(lambda: calls.append(0), 3)
    assert len(calls) == 4 and 0 <= timing.best_s <= timing.median_s and timing.first_s >= 0
    with pytest.raises(ValueError, match="repeats"):
        measure(lambda: None, 0)
    assert machine()["cores"]


@pytest.mark.parametrize("place", ["far", "near", "blocked"])
def test_one_cycle_of_mppi_in_cpp_is_that_of_qocjax(place: str) -> None:
    try:
        from experiments.bench.baselines.mppi_cpp import CppMppi

        cells, pose, path, goal = (np.asarray(each, np.float32) for each in scene())
        config = MppiConfig(batch_size=128, prune_distance=2.5)
        cpp = CppMppi(config, cells, 0.05, (-5.0, -5.0))
    except Unavailable as reason:
        pytest.skip(str(reason))
    if place == "near":  # where the critics of the goal and its heading count
        pose = np.array([1.6, 0.1, 0.4], np.float32)
    if place == "blocked":  # rollouts that go ahead collide, and the path is cut
        cells[:, 68:70] = 253.0
        cpp = CppMppi(config, cells, 0.05, (-5.0, -5.0))
    costs = MapCosts(jnp.asarray(cells), 0.05, (-5.0, -5.0))
    state, cycle = initial_state(config, jnp.float32), jax.jit(step, static_argnums=0)
    for tick in range(3):
        key = jax.random.fold_in(jax.random.key(5), tick)
        command, state, rollouts = cycle(config, state, pose, costs, path, goal, key)
        words = np.asarray(seed_of(jax.random.fold_in(key, 0)))
        sent = cpp.step(pose, path, goal, words)
        assert not bool(rollouts.blocked)
        np.testing.assert_allclose(cpp.cost, rollouts.cost, rtol=2e-4, atol=2e-5)
        np.testing.assert_allclose(sent, [command.nu, command.omega], atol=2e-5)
        np.testing.assert_allclose(cpp.sequence, [state.vx, state.wz], atol=2e-5)
        cpp.sequence[:], cpp.past[:] = (state.vx, state.wz), (state.past_vx, state.past_wz)
    assert (np.max(rollouts.cost) > 100.0) == (place == "blocked")


@pytest.mark.parametrize("deadline", [0.0, 0.2, 0.193])
def test_all_metrics_in_cpp_as_in_qocjax(deadline: float) -> None:
    """Command at the beginning, at the end and inside of a tick; short, so that meeting robots amplify no rounding."""
    values = {name: np.repeat(value, 2) for name, value in DESIGN.items()} | {"kappa": np.array([1.5, 2.5])}
    study = Study(Scenario(horizon=3.0), Design(**values, tau=0.01, deadline=np.full(2, deadline)), range(3))
    run("cpp_metrics", work_of(study))
    found = importlib.import_module("experiments.bench.baselines.cpp_metrics").metrics(work_of(study))
    runs = evaluate(study.scenario, study.designs, NETWORK, study.seeds)
    assert set(found) == set(runs.data_vars)
    assert 0 < found["completed_share"].min() < 1 or deadline == 0
    for name, got in found.items():
        np.testing.assert_allclose(got, runs[name].values.reshape(got.shape), rtol=3e-4, atol=1e-6, err_msg=name)
