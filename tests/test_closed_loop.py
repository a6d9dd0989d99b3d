"""One run against the slow loop, in every mode; limits, gradients and transformations of JAX."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import DEADLINES, HOLD_OPTIONS, MODES, a_case, assert_same_run

from qocjax import Design, Run, Scenario, simulate
from qocjax.network.schedule import ACTUATIONS

TAU, TICKS = 0.1, 20
SMALL = Scenario(start=[[-0.4, -0.3, 0.3], [-0.4, 0.3, 0.0]], goal=[1.0, 0.1], horizon=TAU * TICKS)
RNG = np.random.default_rng(7)
TIMES = np.where(RNG.random((TICKS, 2)) < 0.8, RNG.uniform(0.05, 0.25, (TICKS, 2)), np.inf)


@cache
def traced(actuation: str, hold: str) -> Callable[..., Run]:
    """A run whose numbers are all unknown to the compiler, tau and the deadline too."""
    return jax.jit(lambda s, d, times: simulate(s, d, times, actuation, hold, **HOLD_OPTIONS))


@pytest.mark.parametrize("k", range(len(MODES)), ids=["-".join(mode) for mode in MODES])
def test_all_modes_like_the_slow_loop(k: int) -> None:
    rng = np.random.default_rng(k)
    for kind in DEADLINES * 2:
        case = a_case(rng, kind, num_robots=3, choice=k)
        assert_same_run(traced(*MODES[k])(case.scenario, case.design, case.loop_times), case.slow(*MODES[k]))


@pytest.mark.parametrize(
    ("kind", "actuation", "num_robots"),
    [("zero", "deadline", 2), ("below tau", "deadline", 4), ("on grid", "deadline", 1), ("off grid", "deadline", 9),
     ("typical", "deadline", 8), ("above horizon", "deadline", 5), ("off grid", "arrival", 12)],
)  # fmt: skip
def test_known_timing_and_any_number_of_robots(kind: str, actuation: str, num_robots: int) -> None:
    """Numbers instead of traced values take another program; pairs are summed in a loop from nine robots on."""
    case = a_case(np.random.default_rng(num_robots), kind, num_robots, choice=1 if num_robots == 1 else 0)
    for shift in (0, 3):
        shifted = replace(case, loop_times=np.roll(case.loop_times, shift, axis=0))
        run = simulate(shifted.scenario, shifted.design, shifted.loop_times, actuation)
        assert_same_run(run, shifted.slow(actuation))


def test_deadlines_share_a_program(caplog: pytest.LogCaptureFixture) -> None:
    """On and off the grid of tau, as integers and floats: a loop over deadlines compiles once."""
    scenario = Scenario(start=SMALL.start, horizon=7.13)  # of no other test
    times = np.random.default_rng(0).uniform(0.05, 0.25, (143, 2))
    with jax.log_compiles():
        runs = [simulate(scenario, Design(tau=0.05, deadline=each), times) for each in (0.1, 0.123, 0.25, 0.4, 1)]
    assert 1 <= sum("Compiling jit(_simulate)" in record.getMessage() for record in caplog.records) <= 2
    for run in runs:
        same = traced("deadline", "hold")(scenario, Design(tau=0.05, deadline=run.deadline), times)
        jax.tree.map(lambda one, other: np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6), run, same)
    assert len({float(run.auc[0]) for run in runs}) == len(runs)


def test_without_delay_and_loss_all_actuations_are_one() -> None:
    """`instant` does not delay whatever the deadline, which then only counts in the safety distance: c_miss = 0."""
    none = np.zeros((TICKS, 2))
    free = traced("instant", "hold")(SMALL, Design(tau=TAU, deadline=0.3, c_miss=0.0), none)
    assert np.all(free.command[0, :, 0] > 0)  # in force from the first instant
    for mode in ACTUATIONS:
        run = traced(mode, "hold")(SMALL, Design(tau=TAU, deadline=0.0, c_miss=0.0), none)
        for name in ("pose", "command", "auc", "arrival_time", "age"):
            np.testing.assert_allclose(getattr(run, name), getattr(free, name), rtol=1e-12, atol=1e-12)


def test_nobody_moves_when_every_loop_is_missed() -> None:
    for times, deadline in ((np.full((TICKS, 2), np.inf), 0.2), (np.full((TICKS, 2), 0.21), 0.2)):
        for actuation in ACTUATIONS:
            run = traced(actuation, "hold")(SMALL, Design(tau=TAU, deadline=deadline), times)
            assert np.all(np.asarray(run.pose) == SMALL.start) and np.all(run.command == 0)
            assert run.completed_share == 0 and np.all(run.path_length == 0) and np.all(run.effort == 0)
            np.testing.assert_allclose(run.age, np.broadcast_to(TAU * np.arange(TICKS)[:, None], (TICKS, 2)))


def test_commands_keep_within_the_caps_and_totals_follow_from_them() -> None:
    design = Design(tau=TAU, deadline=0.2, v_max=0.5, omega_max=0.6)
    run = traced("deadline", "hold")(SMALL, design, TIMES)
    nu, omega = np.moveaxis(np.asarray(run.command), -1, 0)
    assert nu.min() >= 0 and nu.max() == 0.5 and np.abs(omega).max() == 0.6
    np.testing.assert_allclose(run.path_length, TAU * nu.sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(run.effort, TAU * (nu**2 + omega**2).sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(np.diff(run.pose[..., 2], axis=0), TAU * omega, atol=1e-12)


def test_transformations_of_jax_change_nothing() -> None:
    deadlines = jnp.array([0.2, 0.23])
    single = [simulate(SMALL, Design(tau=TAU, deadline=float(limit)), TIMES) for limit in deadlines]
    mapped = jax.vmap(lambda limit: simulate(SMALL, Design(tau=TAU, deadline=limit), TIMES))(deadlines)
    within = jax.jit(lambda times: simulate(SMALL, Design(tau=TAU, deadline=0.23), times))(TIMES)
    pairs = [(jax.tree.map(lambda leaf, k=k: leaf[k], mapped), run) for k, run in enumerate(single)]
    for got, wanted in [*pairs, (within, single[1])]:
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(wanted), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def cost(design: Design, scenario: Scenario, mode: tuple[str, str] = MODES[0]) -> jax.Array:
    return simulate(scenario, design, TIMES, *mode, **HOLD_OPTIONS).auc.sum()


value_of = jax.jit(cost, static_argnames="mode")
gradient_of = jax.jit(jax.grad(cost), static_argnames="mode")


@pytest.mark.parametrize(
    ("actuation", "hold", "reference"),
    [("deadline", "hold", "nominal"), ("deadline", "decay", "follow"), ("arrival", "zero", "uncapped")],
)
def test_gradient_is_that_of_finite_differences(actuation: str, hold: str, reference: str) -> None:
    scenario = replace(SMALL, reference=reference)
    design = Design(tau=TAU, deadline=0.23, kappa=1.3, v_max=0.9, omega_max=1.1)
    gradient = gradient_of(design, scenario, mode=(actuation, hold))
    names = ("kappa", "gamma", "eta", "c_miss", "v_max", "omega_max", "d_safe", "deadline")
    for name in names:
        h, at = 1e-6, getattr(design, name)
        moved = (replace(design, **{name: at + step}) for step in (h, -h))
        high, low = (value_of(d, scenario, mode=(actuation, hold)) for d in moved)
        np.testing.assert_allclose(getattr(gradient, name), (high - low) / (2 * h), rtol=1e-5, atol=1e-6, err_msg=name)
    assert sum(abs(float(getattr(gradient, name))) > 1e-3 for name in names) >= 5


@jax.jit
@partial(jax.jacrev, argnums=(0, 1))
def gradients_of(design: Design, scenario: Scenario, times: jax.Array) -> jax.Array:
    run = simulate(scenario, design, times)
    return jnp.stack([run.auc.sum(), run.path_length.sum(), run.effort.sum(), run.min_distance])


CORNERS = {
    "coincident robots": ([[-1, 0, 0.2], [-1, 0, 0.2]], "goal_distance", TIMES),
    "robots at the goal": ([[2, 0, 0.0], [2, 0, 1.0], [-1, 0, 0.2]], "initial_disagreement", np.full((TICKS, 3), 0.01)),
    "all loops lost": ([[-1, 0, 0.2], [-1, 1, 0.2]], "goal_distance", np.full((TICKS, 2), np.inf)),
    "one robot": ([[0, 0, 0.0]], "goal_distance", TIMES[:, :1]),
    "goal straight behind": ([[0, 0, np.pi], [0, -1, np.pi]], "goal_distance", TIMES),
}


@pytest.mark.parametrize(
    "corner", [pytest.param(each, marks=[pytest.mark.slow] if each.startswith("robots") else []) for each in CORNERS]
)
def test_gradient_is_finite_everywhere(corner: str) -> None:
    start, normaliser, times = CORNERS[corner]
    scenario = Scenario(start=start, normaliser=normaliser, horizon=TAU * TICKS)
    gradients = gradients_of(Design(tau=TAU, deadline=0.17), scenario, times)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradients))


def test_gradient_with_known_timing_is_that_with_traced() -> None:
    design = Design(tau=TAU, deadline=0.23, kappa=1.3)
    known = jax.jit(jax.grad(lambda kappa: cost(replace(design, kappa=kappa), SMALL)))(1.3)
    np.testing.assert_allclose(known, gradient_of(design, SMALL, mode=MODES[0]).kappa, rtol=1e-10)


def test_designs_and_scenarios_may_hold_any_leaf_under_transformations() -> None:
    """JAX rebuilds them with gradients (of any sign) or masks in the place of values."""
    assert gradient_of(Design(tau=TAU, deadline=0.23), SMALL, mode=MODES[0]).v_max < 0
    assert jax.tree.map(lambda _: None, Design()).tau is None
    mask = jax.tree.map(lambda _: True, SMALL)
    assert mask.start is True and mask.horizon == SMALL.horizon and mask.reference == "nominal"
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(Design())]
    assert paths[0] == ".v_max"
