"""Gradients of batches: both modes agree, with each other, with finite differences and with one run's own gradient."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qocjax import Design, Rules, Scenario, evaluate, gradient, paper_network
from qocjax._math import EXACT
from qocjax.closed_loop import Plan, run_closed_loop
from qocjax.tunables import CONTINUOUS

SCENARIO = Scenario(horizon=2.0)
NETWORK = paper_network(0.06, 0.02)
SEEDS = range(3)


def slopes(designs: Design, wrt: tuple[str, ...] = CONTINUOUS, mode: str | None = None, **options) -> np.ndarray:
    """[values, designs, seeds]."""
    runs = gradient(SCENARIO, designs, NETWORK, SEEDS, wrt, mode=mode, dtype=jnp.float64, **options)
    return np.stack([runs[f"d_auc_{name}"].values for name in wrt])


# On the grid of tau, between two multiples, within the first tick, and without any lag.
@pytest.mark.parametrize("deadline", [0.08, 0.085, pytest.param(0.004, marks=pytest.mark.slow), 0.0])
def test_modes_agree(deadline: float) -> None:
    designs = Design(kappa=[1.0, 2.5], deadline=deadline)
    np.testing.assert_allclose(slopes(designs, mode="reverse"), slopes(designs, mode="forward"), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(
    "rules",
    [
        pytest.param(Rules(hold="zero"), marks=pytest.mark.slow),
        pytest.param(Rules(hold="decay"), marks=pytest.mark.slow),
        Rules(actuation="instant"),
    ],
)
def test_modes_agree_under_other_rules(rules: Rules) -> None:
    designs = Design(deadline=[0.05, 0.07])
    reverse, forward = (slopes(designs, mode=mode, rules=rules) for mode in ("reverse", "forward"))
    np.testing.assert_allclose(reverse, forward, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("actuation", ["deadline", "arrival"])
def test_finite_differences(actuation: str) -> None:
    designs, step = Design(deadline=0.08), 1e-6
    found = slopes(designs, rules=Rules(actuation))[:, 0]
    for name, slope in zip(CONTINUOUS, found, strict=True):
        value = getattr(designs, name)
        both = replace(designs, **{name: [value - step, value + step]})
        runs = evaluate(SCENARIO, both, NETWORK, SEEDS, rules=Rules(actuation), dtype=jnp.float64)
        cost = runs["auc"].mean("robot").values
        np.testing.assert_allclose(slope, (cost[1] - cost[0]) / (2 * step), rtol=1e-4, atol=1e-6, err_msg=name)


def test_auc_is_that_of_evaluate() -> None:
    designs = Design(gamma=[1.0, 3.0], deadline=0.08)
    cost = evaluate(SCENARIO, designs, NETWORK, SEEDS, dtype=jnp.float64)["auc"].mean("robot")
    for mode in ("forward", "reverse"):
        found = gradient(SCENARIO, designs, NETWORK, SEEDS, mode=mode, dtype=jnp.float64)["auc"]
        np.testing.assert_allclose(found, cost, rtol=1e-12)


@pytest.mark.slow
def test_batch_size_does_not_matter() -> None:
    designs = Design(kappa=[1.0, 1.5, 2.0], deadline=0.08)
    np.testing.assert_allclose(slopes(designs, max_runs=2), slopes(designs, max_runs=512), rtol=1e-10, atol=1e-12)


def test_float32_against_float64() -> None:
    designs = Design(kappa=[1.0, 2.0], deadline=0.08)
    narrow = gradient(SCENARIO, designs, NETWORK, SEEDS, mode="reverse")
    wide = gradient(SCENARIO, designs, NETWORK, SEEDS, mode="reverse", dtype=jnp.float64)
    assert narrow.attrs["math"] == "polynomial" and narrow["d_auc_kappa"].dtype == np.float32
    for name in ("d_auc_kappa", "d_auc_gamma"):
        np.testing.assert_allclose(narrow[name], wide[name], rtol=1e-3, atol=1e-5)


def test_reverse_keeps_blocks_not_ticks() -> None:
    """Checkpoints keep a state per block, not the intermediate values of each tick."""

    def cost(kappa: jax.Array, ticks: int, lag: int) -> jax.Array:
        times = jnp.full((ticks, 2), 0.05)
        plan = Plan(Rules(), EXACT, slots=0, mid_tick=False, lag=lag)
        design = Design(kappa=kappa, deadline=lag * 0.01)
        scenario = Scenario(horizon=ticks * 0.01)
        return run_closed_loop(scenario, design, jnp.asarray(scenario.start), times, plan)[0].integral.sum()

    def temporary_bytes(ticks: int) -> int:
        program = jax.jit(jax.grad(cost), static_argnums=(1, 2)).lower(jnp.asarray(2.0), ticks, 20).compile()
        return program.memory_analysis().temp_size_in_bytes

    bytes_per_tick = (temporary_bytes(4000) - temporary_bytes(2000)) / 2000
    assert bytes_per_tick < 1000  # a tick's own intermediate values of two robots alone would take more


@pytest.mark.parametrize(
    ("wrt", "options", "message"),
    [
        (("tau",), {}, "wrt: got 'tau'"),
        ((), {}, "wrt: got"),
        (("kappa", "kappa"), {}, "wrt: got"),
        (("kappa",), {"mode": "sideways"}, "mode: got 'sideways'"),
        (("kappa",), {"mode": "reverse", "rules": Rules("arrival")}, "mode: got reverse"),
    ],
)
def test_errors(wrt: tuple[str, ...], options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gradient(SCENARIO, Design(), NETWORK, SEEDS, wrt, **options)
