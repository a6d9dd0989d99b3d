"""Functions of angles, arcs, sums over pairs, and the control law in cases that one can work out."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.distance import pdist

from qocjax import Design
from qocjax._math import EXACT, POLYNOMIALS, AngleMath, angle_math
from qocjax.controllers.apf import MIN_DISTANCE, apf
from qocjax.pairs import closest_squared, pair_forces
from qocjax.robots import Command, Pose, arc, pose_from

LONGEST, POLYNOMIAL = POLYNOMIALS[-1]
MATHS = (EXACT, POLYNOMIAL)
STATED_ERRORS = ((2e-9, 1e-11), (2e-9, 1e-11), (3e-8, 3e-9))  # of sinc and cos
POLYNOMIAL_ROUNDING = 1.5e-7  # two and a half units in the last place of a float32 near one


@pytest.mark.parametrize(
    ("limit", "math", "errors"), [(*p, e) for p, e in zip(POLYNOMIALS, STATED_ERRORS, strict=True)]
)
def test_polynomial_sine_and_cosine_keep_their_stated_errors(limit: float, math: AngleMath, errors: tuple) -> None:
    angles = np.linspace(-limit, limit, 40001)
    sinc, cos = jax.jit(math.sinc_cos)(angles)
    assert np.abs(sinc - np.sinc(angles / np.pi)).max() < errors[0]
    assert np.abs(cos - np.cos(angles)).max() < errors[1]
    single = angles.astype(np.float32)
    sinc, cos = jax.jit(math.sinc_cos)(single)
    assert sinc.dtype == cos.dtype == jnp.float32
    assert np.abs(sinc - np.sinc(single.astype(float) / np.pi)).max() < errors[0] + POLYNOMIAL_ROUNDING
    assert np.abs(cos - np.cos(single.astype(float))).max() < errors[1] + POLYNOMIAL_ROUNDING


def test_the_shortest_polynomials_that_hold_are_taken() -> None:
    for limit, math in POLYNOMIALS:
        assert angle_math(limit) is math
    assert angle_math(0.0) is POLYNOMIALS[0][1] and angle_math(LONGEST * 1.001) is EXACT


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1.0, 1e6, 1e17])
def test_polynomial_atan2_keeps_its_stated_error(scale: float) -> None:
    angle = np.linspace(-np.pi, np.pi, 80001)[1:-1]
    radius = scale * np.random.default_rng(0).uniform(0.5, 2, angle.size)
    y, x = ((radius * f(angle)).astype(np.float32) for f in (np.sin, np.cos))
    found = jax.jit(POLYNOMIAL.atan2)(y, x)
    assert found.dtype == jnp.float32
    assert np.abs(found - np.arctan2(y.astype(float), x.astype(float))).max() < 3e-7
    exact = jax.jit(POLYNOMIAL.atan2)(np.sin(angle), np.cos(angle))
    assert np.abs(exact - angle).max() < 4e-8


def slopes(math: AngleMath, function: str, points: tuple) -> list:
    return jax.tree.leaves(jax.jit(jax.vmap(jax.jacfwd(getattr(math, function), tuple(range(len(points))))))(*points))


def test_polynomials_differentiate_like_what_they_stand_for() -> None:
    rng = np.random.default_rng(1)
    cases = [(math, "sinc_cos", (rng.uniform(-limit, limit, 300),)) for limit, math in POLYNOMIALS]
    for math, function, points in [*cases, (POLYNOMIAL, "atan2", tuple(rng.normal(size=(2, 300))))]:
        for one, other in zip(slopes(math, function, points), slopes(EXACT, function, points), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.parametrize("math", MATHS, ids=lambda m: m.name)
def test_atan2_on_the_axes_and_at_the_origin(math) -> None:
    y, x = np.array([0.0, 0.0, 1.0, -1.0, 0.0]), np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(math.atan2(y, x), [0, np.pi, np.pi / 2, -np.pi / 2, 0], atol=1e-7)
    gradients = [jax.grad(math.atan2, argnums=(0, 1))(a, b) for a, b in zip(y, x, strict=True)]
    np.testing.assert_allclose(gradients[:4], np.stack([x, -y], axis=1)[:4], atol=1e-6)
    assert np.all(np.isfinite(gradients[4]))


def test_exact_sinc_is_smooth_at_zero() -> None:
    a = np.array([0.0, 1e-9, 9.9e-5, 1.01e-4, 1.0, 3.0])
    sinc, cos = EXACT.sinc_cos(jnp.asarray(a))
    np.testing.assert_allclose(sinc, np.sinc(a / np.pi), rtol=1e-15)
    np.testing.assert_allclose(cos, np.cos(a), rtol=1e-15)
    slope = jax.vmap(jax.grad(lambda v: EXACT.sinc_cos(v)[0]))(jnp.asarray(a))
    np.testing.assert_allclose(slope[:4], -a[:4] / 3, atol=1e-12)


def one_pose(x: float, y: float, heading: float) -> Pose:
    return pose_from(jnp.asarray([[x, y, heading]]))


@pytest.mark.parametrize(("nu", "omega", "h"), [(0.7, 1.4, 0.5), (0.7, -1.4, 2.0), (0.3, 0.0, 1.0), (0.0, 1.0, 1.0)])
def test_arc_is_the_solution_of_the_unicycle(nu: float, omega: float, h: float) -> None:
    def rates(_, p):
        return nu * np.cos(p[2]), nu * np.sin(p[2]), omega

    end = solve_ivp(rates, (0, h), (0.3, -0.2, 0.9), rtol=1e-11, atol=1e-12).y[:, -1]
    pose = arc(one_pose(0.3, -0.2, 0.9), Command(jnp.array([nu]), jnp.array([omega])), h, EXACT)
    np.testing.assert_allclose(np.ravel([pose.x, pose.y, pose.heading]), end, atol=1e-9)
    np.testing.assert_allclose(np.ravel([pose.cos, pose.sin]), [np.cos(end[2]), np.sin(end[2])], atol=1e-9)


def test_arcs_join_and_close() -> None:
    command = Command(jnp.array([0.7]), jnp.array([1.3]))
    start = one_pose(1.0, 2.0, 0.4)
    twice = arc(arc(start, command, 0.4, EXACT), command, 0.8, EXACT)
    circle = arc(start, command, 2 * np.pi / 1.3, EXACT)
    for got, wanted in ((twice, arc(start, command, 1.2, EXACT)), (circle, start)):
        np.testing.assert_allclose(
            np.ravel([got.x, got.y, got.cos]), np.ravel([wanted.x, wanted.y, wanted.cos]), atol=1e-14
        )
    np.testing.assert_allclose(circle.heading, start.heading + 2 * np.pi)  # continuous, not wrapped


@pytest.mark.parametrize("tau", [0.01, 0.02, 0.1, 0.2])
def test_the_unit_vector_stays_with_the_heading_in_float32(tau: float) -> None:
    """Over 30 s at 10 ms, and as many ticks at longer periods, turning all the while, on the shortest polynomials."""
    math = angle_math(1.9 * tau / 2)
    omega = jnp.asarray(np.random.default_rng(0).uniform(-1.4, 1.4, (3000, 50)) + 0.5, jnp.float32)
    start = pose_from(jnp.zeros((50, 3), jnp.float32))
    nu = jnp.full(50, 0.7, jnp.float32)
    pose, _ = jax.lax.scan(lambda p, w: (arc(p, Command(nu, w), jnp.float32(tau), math), None), start, omega)
    assert pose.cos.dtype == jnp.float32
    heading = tau * np.asarray(omega, float).sum(axis=0)
    assert np.abs(np.hypot(pose.cos, pose.sin) - 1).max() < 3e-5
    assert np.abs(np.remainder(np.arctan2(pose.sin, pose.cos) - heading + np.pi, 2 * np.pi) - np.pi).max() < 3e-5
    assert np.abs(pose.heading - heading).max() < 1e-3


@pytest.mark.parametrize("num_robots", [1, 2, 3, 4, 7, 8, 9, 10, 13])
def test_pairs_are_each_counted_once(num_robots: int) -> None:
    rng = np.random.default_rng(num_robots)
    x, y, other = rng.normal(size=(3, num_robots, 2))
    got = jax.jit(lambda *a: pair_forces(*a, lambda d2, a, b: jnp.exp(-d2) * jnp.maximum(a, b)))(x, y, other)
    for k, along in enumerate((x, y)):
        for i in range(num_robots):
            d2 = (x[i] - x) ** 2 + (y[i] - y) ** 2
            force = np.sum(np.exp(-d2) * np.maximum(other[i], other) * (along[i] - along), axis=0)
            np.testing.assert_allclose(got[k][i], force, atol=1e-13)
    closest = jax.jit(closest_squared)(x, y)
    for b in range(2):
        apart = pdist(np.c_[x[:, b], y[:, b]])
        np.testing.assert_allclose(closest[b], apart.min() ** 2 if num_robots > 1 else np.inf)


def command_of(start: list, age: list, **changes: float) -> np.ndarray:
    command = apf(
        pose_from(jnp.asarray(start)), jnp.asarray(age), (jnp.array(2.0), jnp.array(0.0)), Design(**changes), EXACT
    )
    return np.stack([command.nu, command.omega])


def test_law_by_hand() -> None:
    ahead, behind, aside = ([[x, y, heading]] for x, y, heading in ((1.9, 0, 0.0), (1.9, 0, np.pi), (1.9, 0, 0.5)))
    np.testing.assert_allclose(command_of(ahead, [0.3]).ravel(), [0.2, 0], atol=1e-15)
    np.testing.assert_allclose(command_of(aside, [0.3]).ravel(), [0.2 * np.cos(0.5), -1.0])
    assert command_of(behind, [0.3])[0, 0] == 0 and abs(command_of(behind, [0.3])[1, 0]) == 1.4
    np.testing.assert_allclose(command_of([[-9, 0, 0.0]], [0.3]).ravel(), [0.7, 0], atol=1e-15)
    # Two robots 0.4 m apart across the line to the goal: eta (1/d - 1/d_eff) / d² away from each other.
    pair = [[2.0, 0.2, np.pi / 2], [2.0, -0.2, -np.pi / 2]]
    for age, reach in (([0.3, 0.3], 0.5), ([0.1, 0.2], 0.5), ([0.3, 1.3], 0.7), ([1.3, 0.3], 0.7)):
        push = 0.02 * (1 / 0.4 - 1 / reach) / 0.4**2
        out = command_of(pair, age, eta=0.02, kappa=0.1)
        np.testing.assert_allclose(out[0], push - 0.1 * 0.2, rtol=1e-12)


def test_law_at_the_floor_of_the_distance() -> None:
    """Coincident robots do not push each other; at the floor they push with all their might, and finitely."""
    start = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(command_of(start, [0.3, 0.3]), [[0.7, 0.7], [0, 0]], atol=1e-15)
    start[0][0] = MIN_DISTANCE / 2
    assert command_of(start, [0.3, 0.3])[0].tolist() == [0.7, 0.0]
