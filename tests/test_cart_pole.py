"""The cart-pole between commands against SciPy's integrator, and its loop against the eigenvalues of the linear one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from qocjax import Rules
from qocjax.plants import cleave_cart_pole, simulate_cart_pole
from qocjax.plants.cart_pole import CartPole, accelerations, feedback, motion

CLEAVE = cleave_cart_pole()
SMOOTH = replace(CLEAVE, friction=0.0)
TICK = 1 / 120


def equations(plant: CartPole, x: np.ndarray, force: float) -> np.ndarray:
    """Both Lagrange equations as one linear system, written anew."""
    ml = plant.pole_mass * plant.pole_centre
    cos, sin = np.cos(x[2]), np.sin(x[2])
    inertia = np.array([[plant.cart_mass + plant.pole_mass, -ml * cos],
                        [-ml * cos, plant.pole_inertia + ml * plant.pole_centre]])  # fmt: skip
    return np.linalg.solve(inertia, [force - ml * sin * x[3] ** 2, ml * plant.gravity * sin])


def followed(plant: CartPole, x: np.ndarray, force: float, end: float) -> np.ndarray:
    """The true motion under a constant force, with the friction of a cart that slides, and of one that is held."""
    most = plant.friction * (plant.cart_mass + plant.pole_mass) * plant.gravity
    ml = plant.pole_mass * plant.pole_centre
    about = plant.pole_inertia + ml * plant.pole_centre  # a joint that stands still

    def held(_: float, x: np.ndarray) -> list[float]:
        return [0.0, 0.0, x[3], ml * plant.gravity * np.sin(x[2]) / about]

    def spare(_: float, x: np.ndarray) -> float:
        return most - abs(force + ml * (np.cos(x[2]) * held(0, x)[3] - np.sin(x[2]) * x[3] ** 2))

    def sliding(_: float, x: np.ndarray, way: float) -> list[float]:
        cart, pole = equations(plant, x, force - way * most)
        return [x[1], cart, x[3], pole]

    def turns(_: float, x: np.ndarray, way: float) -> float:
        return way * x[1] + 1e-14

    for event in (spare, turns):
        event.terminal, event.direction = True, -1.0
    at, accurate = 0.0, {"rtol": 1e-11, "atol": 1e-13}
    while at < end:
        if x[1] == 0.0 and spare(at, x) > 0.0:
            found = solve_ivp(held, (at, end), x, events=spare, **accurate)
        else:
            way = np.sign(x[1]) or np.sign(force + ml * held(0, x)[3])
            found = solve_ivp(sliding, (at, end), x, events=turns, args=(way,), **accurate)
        at, x = found.t[-1], found.y[:, -1].copy()
        x[1] = 0.0 if abs(x[1]) < 1e-12 and most > 0.0 else x[1]
    return x


@partial(jax.jit, static_argnums=0)
def stepped(plant: CartPole, x: jax.Array, force: jax.Array) -> jax.Array:
    """Half a second of steps."""
    return jax.lax.fori_loop(0, 240, lambda _, x: motion(plant, x, force, jnp.asarray(plant.step)), x)


@pytest.mark.parametrize("force", [-6.0, 0.0, 1.5])
@pytest.mark.parametrize("x", [(0.0, 0.0, 0.02, 0.0), (0.1, -0.4, -0.3, 0.5)])
def test_motion_without_friction(x: tuple[float, ...], force: float) -> None:
    found = stepped(SMOOTH, np.array(x)[:, None], np.array([force]))[:, 0]
    np.testing.assert_allclose(found, followed(SMOOTH, np.array(x), force, 0.5), atol=2e-8)


def test_equations_are_those_of_lagrange() -> None:
    rng = np.random.default_rng(0)
    x, force = rng.normal(size=(4, 20)), rng.normal(size=20)
    found = np.stack(accelerations(CLEAVE, jnp.asarray(x), jnp.asarray(force)))
    wanted = np.stack([equations(CLEAVE, each, push) for each, push in zip(x.T, force, strict=True)], axis=1)
    np.testing.assert_allclose(found, wanted, rtol=1e-11)


@pytest.mark.parametrize(
    ("x", "force"),
    [
        ((0.0, 0.5, 0.0, 0.0), 0.0),  # slides all the time
        ((0.0, 0.01, 0.0, 0.0), 0.0),  # comes to rest
        ((0.0, 0.0, 0.0003, 0.0), 0.0),  # is held until the pole has fallen far enough
        ((0.0, 0.002, 0.001, -0.003), -0.1),  # turns round
    ],
)
def test_motion_with_friction(x: tuple[float, ...], force: float) -> None:
    found = stepped(CLEAVE, np.array(x)[:, None], np.array([force]))[:, 0]
    wanted = followed(CLEAVE, np.array(x), force, 0.5)
    np.testing.assert_allclose(found, wanted, atol=2e-4)
    assert np.abs(followed(SMOOTH, np.array(x), force, 0.5) - wanted).max() > 2e-3  # friction is what is tested


def test_ground_holds_the_cart() -> None:
    found = stepped(CLEAVE, np.zeros((4, 3)), np.array([0.05, -0.06, 0.075]))  # of 0.0686 N that it can hold
    assert np.abs(found[:, :2]).max() < 1e-12
    assert found[0, 2] > 1e-4


def test_law_of_cleave() -> None:
    x = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.36], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(feedback(CLEAVE, jnp.asarray(x))[0], [-11.851380879, 25.0, 0.0])


@pytest.mark.parametrize(("rate", "ticks"), [(10, 1), (10, 2), (20, 2), (20, 3), (40, 4), (40, 5), (60, 5)])
def test_small_angles_grow_as_eigenvalues_say(rate: int, ticks: int) -> None:
    """Without friction, at a constant delay: samples each 1/rate, commands applied some ticks of 1/120 s later."""
    growth, between = largest_eigenvalue(rate, ticks), 120 // rate
    times = np.full((120 * 5, 1), np.inf)
    times[::between] = (ticks - 0.5) * TICK
    run = simulate_cart_pole(SMOOTH, times, tau=TICK, deadline=1.0, rules=Rules("arrival"), start=[0, 0, 1e-9, 0],
                             record=True)  # fmt: skip
    size = np.abs(np.asarray(run.recorded[0].x)[::between, 2, 0])
    second = size.reshape(5, -1).max(axis=1)
    assert (growth > 1.0) == (second[-1] > second[-3])
    assert np.log(second[-1] / second[-3]) / (2 * rate) == pytest.approx(np.log(growth), abs=0.02)


def largest_eigenvalue(rate: int, ticks: int) -> float:
    """Of the linear loop over one sample, with z = [x; the last commands]."""
    a, b = np.zeros((4, 4)), np.zeros((4, 1))
    a[[0, 2], [1, 3]] = 1.0
    small = 1e-6
    a[[1, 3], 2] = equations(SMOOTH, np.array([0, 0, small, 0]), 0.0) / small
    b[[1, 3], 0] = equations(SMOOTH, np.zeros(4), 1.0)
    whole = expm(np.block([[a, b], [np.zeros((1, 5))]]) * TICK)
    past = -(-ticks * rate // 120)
    z = np.eye(4 + past)
    commands = [-np.array([SMOOTH.gains]) @ z[:4], *(z[4 + k : 5 + k] for k in range(past))]
    x = z[:4]
    for tick in range(120 // rate):
        age = next(k for k in range(past + 1) if k * (120 // rate) + tick >= ticks)
        x = whole[:4, :4] @ x + whole[:4, 4:] @ commands[age]
    return np.abs(np.linalg.eigvals(np.vstack([x, *commands[:past]]))).max()


def test_pole_topples_when_all_is_lost() -> None:
    run = simulate_cart_pole(
        SMOOTH, np.full((240, 2), np.inf), tau=TICK, deadline=0.1, start=[[0, 0, 0.01, 0], [0] * 4]
    )
    assert run.state.peak[0] > CLEAVE.fail_angle
    assert run.state.peak[1] == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cart_mass": 0.0}, "cart_mass: got 0.0, expected > 0"),
        ({"friction": -0.1}, "friction: got -0.1, expected >= 0"),
        ({"gains": (1.0, 2.0)}, r"gains: got shape \(2,\), expected \(4,\)"),
    ],
)
def test_wrong_cart_is_refused(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(CLEAVE, **change)


def test_wrong_start_is_refused() -> None:
    with pytest.raises(ValueError, match=r"start: got shape \(3,\), expected \(4,\) or \(2, 4\)"):
        simulate_cart_pole(CLEAVE, np.zeros((5, 2)), tau=TICK, deadline=0.1, start=[0.0] * 3)
