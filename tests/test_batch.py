"""Many runs at once are the runs one by one, whatever else is evaluated with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from cases import GivenNetwork

import qocjax.batch.layout as layout
from qocjax import Design, Rules, Scenario, evaluate, paper_network, replay

NETWORK = paper_network(0.2, 0.1)
CLOSE = Scenario(start=[[-0.4, -0.3, 0.3], [-0.4, 0.3, 0.0]], goal=[1.0, 0.1], horizon=2.0)
GRID = Design(kappa=[1.0, 2.0, 3.0, 1.0], eta=[0.6, 0.2, 1.0, 0.0], d_safe=[0.5, 0.4, 0.8, 0.3], tau=0.1, deadline=0.23)
METRICS = {
    "auc", "path_length", "effort", "arrival_time", "min_distance", "collided", "completed_share", "age_mean",
    "age_peak",
}  # fmt: skip


def design_of(grid: Design, k: int) -> Design:
    return jax.tree.map(lambda value: float(np.ravel(value)[k]) if np.ndim(value) else value, grid)


def assert_like_replay(
    runs: xr.Dataset, scenario: Scenario, grid: Design, cells: list[tuple[int, int]], rules: Rules | None = None
) -> None:
    """Compares the runs of (design, seed) with the same runs one by one."""
    assert set(runs.data_vars) == METRICS
    for k, seed in cells:
        run = replay(scenario, design_of(grid, k), NETWORK, seed, rules=rules, key=3)
        for name in METRICS:
            got = runs[name].isel(design=k).sel(seed=seed)
            np.testing.assert_allclose(got, getattr(run, name), rtol=1e-9, atol=1e-12, err_msg=f"{name} {k} {seed}")


def exact(scenario: Scenario, grid: Design, seeds: Any, **options: Any) -> xr.Dataset:
    return evaluate(scenario, grid, NETWORK, seeds, dtype=jnp.float64, key=3, **options)


@pytest.fixture(scope="module")
def base() -> xr.Dataset:
    return exact(CLOSE, GRID, range(40))


@pytest.mark.parametrize(
    "mode", [pytest.param("deadline-decay", marks=pytest.mark.slow), "arrival-zero", "instant-timeout"]
)
def test_batch_is_replay_under_all_rules(mode: str) -> None:
    rules = Rules(*mode.split("-"), hold_timeout=0.35, hold_decay=0.4)
    assert_like_replay(exact(CLOSE, GRID, [5, 2], rules=rules), CLOSE, GRID, [(0, 5), (1, 2), (2, 5)], rules)


@pytest.mark.parametrize("num_robots", [1, 3, pytest.param(9, marks=pytest.mark.slow)])
def test_batch_is_replay_for_any_number_of_robots(num_robots: int) -> None:
    turn = np.linspace(0, 2 * np.pi, num_robots, endpoint=False)
    start = np.c_[0.8 * np.cos(turn), 0.8 * np.sin(turn), turn]
    scenario = Scenario(start=start, goal=[0.3, 0.2], horizon=2.0, normaliser="goal_distance", weights=[1.0, 2.5])
    grid = replace(GRID, deadline=0.3)
    assert_like_replay(exact(scenario, grid, [1, 4]), scenario, grid, [(0, 1), (2, 4)])


@pytest.mark.parametrize("reference", [pytest.param("follow", marks=pytest.mark.slow), "uncapped"])
def test_batch_is_replay_with_a_reference_per_robot(reference: str) -> None:
    goals = [[1.0, 0.1], [0.9, -0.4]]
    scenario = replace(
        CLOSE,
        reference=reference,
        reference_per_robot=True,
        goal=goals,
        normaliser="goal_distance",
        start_jitter=(0.3, 0.5),
    )
    grid = Design(kappa=[0.5, 3.0], v_max=[0.3, 1.2], tau=0.1, deadline=0.2)
    assert_like_replay(exact(scenario, grid, [0, 7]), scenario, grid, [(0, 0), (1, 7)])


@pytest.mark.slow
def test_any_tau_and_deadline_side_by_side() -> None:
    """Dividing the horizon or not, deadlines zero, below tau, as long as the horizon: all in one grid."""
    tau, deadline = [0.1, 0.3, 0.07, 0.1], [0.0, 0.45, 0.21, 2.0]
    grid = Design(tau=tau, deadline=deadline, v_max=[0.7, 0.9, 0.5, 0.7])
    runs = exact(CLOSE, grid, [3])
    assert_like_replay(runs, CLOSE, grid, [(k, 3) for k in range(3)])
    assert np.all(runs["completed_share"][3] == 1) and np.all(runs["path_length"][3] == 0)  # due at its end


@pytest.mark.parametrize("max_runs", [1, 3, 50, 100_000])
def test_results_do_not_depend_on_the_batches(base: xr.Dataset, max_runs: int) -> None:
    seeds = range(40) if max_runs > 1 else range(2)
    xr.testing.assert_allclose(exact(CLOSE, GRID, seeds, max_runs=max_runs), base.sel(seed=list(seeds)), rtol=1e-9)


def test_results_do_not_depend_on_what_else_is_evaluated(base: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds, places = [17, 0, 39, 5], [3, 1]
    some = jax.tree.map(lambda value: np.asarray(value)[places] if np.ndim(value) else value, GRID)
    wanted = base.sel(seed=seeds).isel(design=places)
    xr.testing.assert_allclose(exact(CLOSE, some, seeds), wanted, rtol=1e-9)
    more = replace(
        some, tau=[0.1, 0.1, 0.05], deadline=[0.23, 0.23, 0.2],
        **{name: [*getattr(some, name), 0.9] for name in ("kappa", "eta", "d_safe")},
    )  # fmt: skip
    xr.testing.assert_allclose(exact(CLOSE, more, seeds).isel(design=[0, 1]), wanted, rtol=1e-9)
    monkeypatch.setattr(layout, "_WORTH_A_PROGRAM", 0.0)  # a program made for this tau instead of a general one
    xr.testing.assert_allclose(exact(CLOSE, some, seeds), wanted, rtol=1e-9)
    assert not np.allclose(evaluate(CLOSE, some, NETWORK, seeds, key=4)["auc"], wanted["auc"], rtol=1e-3)


def test_the_same_call_gives_the_same_bits_and_designs_share_loop_times() -> None:
    grid = Design(kappa=[2.0, 1.0, 2.0, 2.0], gamma=[2.0, 3.0, 2.0, 2.0], tau=[0.1, 0.1, 0.1, 0.05], deadline=0.25)
    options = {"rules": Rules(hold="decay"), "max_runs": 20}
    first, second = (evaluate(CLOSE, grid, NETWORK, range(12), **options) for _ in range(2))
    xr.testing.assert_identical(first, second)
    xr.testing.assert_equal(first.isel(design=0, drop=True), first.isel(design=2, drop=True))
    for name in ("completed_share", "age_mean", "age_peak"):
        np.testing.assert_array_equal(first[name][0], first[name][1])
        assert np.any(first[name][0] != first[name][3])
    assert np.all(first["auc"][0] != first["auc"][1])


def test_float32_is_float64_in_the_mean_over_seeds() -> None:
    scenario = Scenario(horizon=12.0)
    grid = Design(tau=0.05, deadline=[0.15, 0.2, 0.32, 0.5], omega_max=[1.4, 1.4, 1.4, 2.5])
    single, double = (evaluate(scenario, grid, paper_network(), range(48), dtype=d) for d in ("float32", "float64"))
    assert (single.attrs["math"], double.attrs["math"]) == ("polynomial", "exact")
    for name in ("auc", "path_length", "effort", "min_distance"):
        means = [np.mean(runs[name].values.reshape(4, -1), axis=1) for runs in (single, double)]
        np.testing.assert_allclose(*means, rtol=0.02, err_msg=name)
    for name in ("completed_share", "age_mean", "age_peak"):
        np.testing.assert_allclose(single[name], double[name], rtol=1e-5, err_msg=name)


@pytest.mark.parametrize("wide", [True, False])
def test_float32_stays_float32(wide: bool) -> None:
    with jax.enable_x64(wide):
        runs = evaluate(CLOSE, replace(GRID, omega_max=19.9), NETWORK, [0])
        fast = evaluate(CLOSE, replace(GRID, omega_max=20.1), NETWORK, [0])
        if not wide:
            with pytest.raises(ValueError, match="dtype"):
                evaluate(CLOSE, GRID, NETWORK, [0], dtype=jnp.float64)
    assert {name: values.dtype for name, values in runs.data_vars.items() if values.dtype != np.float32} == {
        "collided": np.dtype(bool)
    }
    assert (runs.attrs["math"], runs.attrs["dtype"], fast.attrs["math"]) == ("polynomial", "float32", "exact")


@pytest.mark.parametrize("hold", ["zero", "timeout", "decay"])
def test_holds_stay_float32_under_x64(hold: str) -> None:
    assert (
        evaluate(CLOSE, Design(tau=0.1, deadline=0.23), NETWORK, [0], rules=Rules(hold=hold))["auc"].dtype == np.float32
    )


def test_what_comes_back_is_labelled_and_progress_adds_up() -> None:
    done: list[int] = []
    runs = evaluate(CLOSE, GRID, GivenNetwork(), [4, 9], progress=done.append, max_runs=4)
    assert runs["auc"].dims == ("design", "seed", "robot") and runs["age_mean"].dims == ("design", "seed")
    assert runs["seed"].values.tolist() == [4, 9] and runs["kappa"].values.tolist() == [1, 2, 3, 1]
    assert runs["auc"].units == "s" and runs["tau"].units == "s" and runs["path_length"].units == "m"
    assert sum(done) == 4 * 2 * 2 * 20
    assert np.ptp(runs["completed_share"].values) == 0 and np.ptp(runs["auc"].values[0]) > 0  # the starts are jittered
    still = evaluate(replace(CLOSE, start_jitter=(0.0, 0.0)), GRID, GivenNetwork(), [4, 9])
    assert np.ptp(still["auc"].values, axis=1).max() == 0
