"""The check values of the model (section 11): in float64, in float32, one run and in a batch."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from cases import Case, GivenNetwork
from test_slow_loop import CHECK, check_loop_times

from qocjax import Design, Rules, Scenario, evaluate, simulate

ROWS = range(len(CHECK))
NAMES = [f"{row[3]}-{1e3 * row[0]:g}ms" for row in CHECK]
SCENARIO = Scenario(start_jitter=(0.0, 0.0))


def design(row: int) -> Design:
    deadline, tau, change, *_ = CHECK[row]
    return Design(deadline=deadline, tau=tau, **change)


@cache
def slow(row: int) -> dict:
    return Case(SCENARIO, design(row), check_loop_times(round(30 / CHECK[row][1]))).slow(CHECK[row][3])


def found(run) -> list[float]:
    """The five numbers of a row of the table."""
    return [*np.asarray(run.auc), float(run.min_distance), *np.asarray(run.pose)[-1, 0, :2]]


@pytest.mark.parametrize("row", ROWS, ids=NAMES)
def test_simulate_in_float64(row: int) -> None:
    run = simulate(SCENARIO, design(row), check_loop_times(round(30 / CHECK[row][1])), CHECK[row][3])
    np.testing.assert_allclose(found(run), CHECK[row][4], rtol=1e-4, atol=1e-4)  # the table has four decimals
    np.testing.assert_allclose(run.auc, slow(row)["auc"], rtol=1e-4)
    # Not the headings: at a balance of forces the desired velocity is rounding noise, and so is its direction.
    np.testing.assert_allclose(run.pose[..., :2], slow(row)["pose"][..., :2], rtol=0, atol=1e-6)
    for name in ("age", "min_distance", "path_length", "arrival_time"):
        np.testing.assert_allclose(getattr(run, name), slow(row)[name], rtol=1e-6, atol=1e-6, err_msg=name)


@cache
def end_is_settled(row: int) -> bool:
    """Whether starts a few micrometres off end, in float64, at the same place; else float32 cannot tell where."""
    times = check_loop_times(round(30 / CHECK[row][1]))
    moved = (replace(SCENARIO, start=SCENARIO.start + step) for step in (0.0, 1e-6, [[3e-6, -2e-6, 1e-6]]))
    ends = [simulate(scenario, design(row), times, CHECK[row][3]).pose[-1, 0, :2] for scenario in moved]
    return bool(np.ptp(np.stack(ends), axis=0).max() < 1e-3)


@cache
def traced(actuation: str):
    """A run with tau and the deadline unknown to the compiler: one program for many rows."""
    return jax.jit(lambda scenario, design, times: simulate(scenario, design, times, actuation))


@pytest.mark.parametrize("row", ROWS, ids=NAMES)
def test_simulate_in_float32(row: int) -> None:
    with jax.enable_x64(False):
        run = traced(CHECK[row][3])(
            SCENARIO, design(row), check_loop_times(round(30 / CHECK[row][1])).astype(np.float32)
        )
        assert {leaf.dtype for leaf in jax.tree.leaves(run)} == {jnp.dtype(bool), jnp.dtype(jnp.float32)}
    np.testing.assert_allclose(found(run)[:3], CHECK[row][4][:3], rtol=0.02, atol=1e-4)
    if end_is_settled(row):
        np.testing.assert_allclose(found(run)[3:], CHECK[row][4][3:], rtol=0.02, atol=1e-4)


@cache
def batch(actuation: str, dtype: str) -> xr.Dataset:
    """The rows of one actuation, as designs of one evaluation."""
    values = [design(row) for row in ROWS if CHECK[row][3] == actuation]
    designs = replace(values[0], **{n: [getattr(d, n) for d in values] for n in ("tau", "deadline", "eta")})
    return evaluate(SCENARIO, designs, GivenNetwork(), [0], rules=Rules(actuation), dtype=dtype).isel(seed=0)


@pytest.mark.parametrize(("dtype", "rtol"), [("float64", 1e-4), ("float32", 0.02)])
@pytest.mark.parametrize("row", ROWS, ids=NAMES)
def test_evaluate(row: int, dtype: str, rtol: float) -> None:
    actuation = CHECK[row][3]
    runs = batch(actuation, dtype)
    assert runs.attrs["math"] == ("exact" if dtype == "float64" else "polynomial")
    run = runs.isel(design=[r for r in ROWS if CHECK[r][3] == actuation].index(row))
    np.testing.assert_allclose(run["auc"], CHECK[row][4][:2], rtol=rtol, atol=1e-4)
    np.testing.assert_allclose(run["min_distance"], CHECK[row][4][2], rtol=rtol, atol=1e-4)
    for name, other in (("completed_share", "completed"), ("age_mean", "mean_age"), ("age_peak", "peak_age")):
        np.testing.assert_allclose(run[name], slow(row)[other], rtol=1e-5, err_msg=name)
