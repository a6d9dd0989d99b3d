"""The barrier: its programme against SciPy's, the law against one written in plain Python, robots that keep apart."""

from __future__ import annotations

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from qocjax import Design, Scenario, evaluate, paper_network, simulate
from qocjax._math import EXACT
from qocjax.controllers import Apf, Cbf, Sight, Task
from qocjax.controllers.halfplanes import HalfPlanes, nearest
from qocjax.robots import pose_from


def planes(angles: np.ndarray, bounds: np.ndarray) -> HalfPlanes:
    return HalfPlanes(jnp.cos(angles), jnp.sin(angles), jnp.asarray(bounds))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_nearest_point_is_that_of_a_solver(count: int) -> None:
    rng = np.random.default_rng(count)
    angles, bounds = rng.uniform(0, 2 * np.pi, (count, 60)), rng.uniform(-1.5, 0.3, (count, 60))
    x, y = rng.normal(size=(2, 60))
    found_x, found_y, admissible = (np.asarray(each) for each in nearest(x, y, planes(angles, bounds)))
    for k in range(60):
        normals = np.stack([np.cos(angles[:, k]), np.sin(angles[:, k])])

        def room(v: np.ndarray, normals: np.ndarray = normals, k: int = k) -> np.ndarray:
            return v @ normals - bounds[:, k]

        given = np.array([x[k], y[k]])
        solved = minimize(
            lambda v, given=given: ((v - given) ** 2).sum(), np.zeros(2), method="SLSQP",
            constraints={"type": "ineq", "fun": room}, options={"ftol": 1e-14, "maxiter": 300},
        )  # fmt: skip
        assert admissible[k] == (room(solved.x).min() > -1e-7)
        if admissible[k]:
            np.testing.assert_allclose([found_x[k], found_y[k]], solved.x, atol=1e-6)


def test_nearest_point_by_hand() -> None:
    """Inside, at a border, in a corner, between parallel borders, without any, where nothing is admissible."""
    right, up, left = 0.0, np.pi / 2, np.pi
    for angles, bounds, given, expected in (
        ([right], [-1.0], (0.0, 0.0), (0.0, 0.0)),
        ([right], [2.0], (0.0, 3.0), (2.0, 3.0)),
        ([right, up], [1.0, 1.0], (0.0, 0.0), (1.0, 1.0)),
        ([right, left], [-1.0, -1.0], (5.0, 2.0), (1.0, 2.0)),
        ([], [], (5.0, 2.0), (5.0, 2.0)),
    ):
        found = nearest(jnp.array(given[0]), jnp.array(given[1]), planes(np.array(angles), np.array(bounds)))
        np.testing.assert_allclose(found[:2], expected, atol=1e-12)
        assert bool(found[2])
    squeezed = nearest(jnp.array(0.0), jnp.array(0.0), planes(np.array([right, left]), np.array([1.0, 0.5])))
    assert not bool(squeezed[2])


def plain(poses: np.ndarray, ages: np.ndarray, goal: np.ndarray, design: Design, alpha: float) -> list[list[float]]:
    """The law for one robot after the other, its programme by a solver."""
    found = []
    for i, (x, y, heading) in enumerate(poses):
        place = np.array([x, y])
        nominal = design.kappa * (goal - place)
        nominal *= min(1.0, design.v_max / np.linalg.norm(nominal))
        limits = []
        for j, other in enumerate(poses):
            if j != i:
                apart = place - other[:2]
                stale = max(0.0, max(ages[i], ages[j]) - design.deadline)
                barrier = np.linalg.norm(apart) - (design.d_safe + design.c_miss * stale)
                limits.append((apart / np.linalg.norm(apart), -alpha / 2 * barrier))
        v = minimize(lambda v, nominal=nominal: ((v - nominal) ** 2).sum(), np.zeros(2), method="SLSQP",
                     constraints=[{"type": "ineq", "fun": lambda v, n=n, b=b: n @ v - b} for n, b in limits],
                     options={"ftol": 1e-14, "maxiter": 300}).x  # fmt: skip
        error = math.remainder(math.atan2(v[1], v[0]) - heading, 2 * math.pi)
        nu, omega = np.linalg.norm(v) * max(math.cos(error), 0.0), design.gamma * error
        found.append([min(nu, design.v_max), min(max(omega, -design.omega_max), design.omega_max)])
    return found


def test_law_is_that_of_plain_python() -> None:
    rng = np.random.default_rng(4)
    design, goal, law = Design(deadline=0.1, c_miss=0.5), np.array([0.3, -0.2]), Cbf(alpha=1.5)
    task = Task((jnp.array(goal[0]), jnp.array(goal[1])), design, EXACT, 10, jnp.array(0), jnp.array(0.0), 0)
    for _ in range(20):
        poses, ages = rng.uniform(-1, 1, (4, 3)) * [1.5, 1.5, 3], rng.uniform(0, 0.6, 4)
        expected = plain(poses, ages, goal, design, 1.5)
        pose = pose_from(jnp.asarray(poses))
        squeezed, command, _ = law.command(task, law.begin(task, pose, None), Sight(0, pose, jnp.asarray(ages), None))
        free = np.asarray(squeezed) == 0.0
        np.testing.assert_allclose(
            np.stack([command.nu, command.omega], axis=-1)[free], np.array(expected)[free], atol=1e-5
        )
        assert free.sum() >= 2


def test_robots_keep_apart_where_the_field_lets_them_meet() -> None:
    scenario, design = Scenario(horizon=8.0), Design(deadline=np.array([0.15, 0.5]))
    barrier, field = (evaluate(scenario, design, paper_network(), range(16), controller=law) for law in (Cbf(), Apf()))
    assert field["collided"].values[1].mean() > 0.5
    assert not barrier["collided"].values.any()
    np.testing.assert_array_equal(barrier["age_mean"], field["age_mean"])  # the same loops
    assert set(barrier.data_vars) - set(field.data_vars) == {"squeezed"}


def test_one_robot_has_nothing_to_keep_from() -> None:
    """Where the goal is so near that nothing is capped, it is the surrogate law."""
    scenario = Scenario(start=np.array([[1.8, 0.1, 0.3]]), horizon=4.0, normaliser="goal_distance")
    times = np.full((400, 1), 0.05)
    runs = [simulate(scenario, Design(deadline=0.1), times, controller=law) for law in (Cbf(), Apf())]
    np.testing.assert_allclose(runs[0].pose, runs[1].pose, atol=1e-9)


def test_coincident_robots_part() -> None:
    scenario = Scenario(start=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), horizon=6.0, normaliser="goal_distance")
    scenario = replace(scenario, goal=np.array([2.0, 0.0]))
    run = simulate(scenario, Design(deadline=0.02), np.zeros((600, 2)), controller=Cbf())
    assert np.isfinite(run.pose).all()
    assert np.hypot(*(run.pose[-1, 0, :2] - run.pose[-1, 1, :2])) > 0.4


def test_what_it_does_not_read_is_refused() -> None:
    with pytest.raises(ValueError, match="eta: got several values, but Cbf does not read it"):
        evaluate(Scenario(), Design(eta=np.array([0.1, 0.2])), paper_network(), range(2), controller=Cbf())
    with pytest.raises(ValueError, match="alpha: got 0"):
        Cbf(alpha=0.0)
