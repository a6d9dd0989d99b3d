"""A cart with a pole that falls over: the plant and the controller of CLEAVE.

CLEAVE (Olguín Muñoz, Roy and Gross, EdgeSys 2022) emulates it with a physics engine; `cleave_cart_pole` has the masses,
lengths, friction and gains of its published code (github.com/KTH-EXPECA/CLEAVE, cleave/impl/inverted_pendulum.py).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.network.schedule import Rules
from qocjax.plants.driven import Driven, Instant, Move, Plant, check_timing, drive, piece_lengths, room_for

__all__ = ["CartPole", "CartPoleState", "cleave_cart_pole", "simulate_cart_pole"]


@dataclass(frozen=True)
class CartPole:
    """Cart, pole and state feedback with a limit; angles count to the left, as the engine's do.

    Attributes:
        cart_mass: M (kg).
        pole_mass: m (kg).
        pole_centre: Distance l of the pole's centre of mass from the joint (m).
        pole_inertia: I about that centre (kg m²).
        friction: Coulomb coefficient between cart and ground.
        gravity: g (m/s²).
        gains: k of the force -k·[position, speed, angle, angular speed] (N/m, N s/m, N/rad, N s/rad).
        max_force: Limit on the force (N).
        give_up_angle: Beyond it the controller asks for no force (rad).
        fail_angle: A pole that has been this far from upright has toppled (rad).
        step: Longest step of the integration (s).
    """

    cart_mass: float
    pole_mass: float
    pole_centre: float
    pole_inertia: float
    friction: float
    gains: tuple[float, float, float, float]
    max_force: float
    give_up_angle: float
    fail_angle: float
    gravity: float = 9.8
    step: float = 1 / 480

    def __post_init__(self) -> None:
        gains = np.asarray(_checks.numbers("gains", self.gains, (4,)), float)
        object.__setattr__(self, "gains", tuple(gains.tolist()))  # a tuple, so that a plant hashes
        for name in {item.name for item in fields(self)} - {"gains", "friction", "pole_inertia"}:
            _checks.bounded(name, getattr(self, name), above=0.0, shape=())
        for name in ("friction", "pole_inertia"):
            _checks.bounded(name, getattr(self, name), least=0.0, shape=())


def cleave_cart_pole() -> CartPole:
    """The inverted pendulum of CLEAVE; the engine multiplies the friction of cart and ground, 0.1 each."""
    return CartPole(
        cart_mass=0.5,
        pole_mass=0.2,
        pole_centre=0.6,
        pole_inertia=0.001,
        friction=0.01,
        gains=(-57.38901804, -36.24133932, 118.51380879, 28.97241832),
        max_force=25.0,
        give_up_angle=0.35,
        fail_angle=0.34,
    )


class CartPoleState(NamedTuple):
    """N carts at one instant."""

    x: Array  # [4, N] position (m), speed (m/s), angle (rad), angular speed (rad/s)
    peak: Array  # [N] rad, largest angle from upright so far, at the ends of pieces
    square: Array  # [N] ∫ angle² dt (rad² s), while it has not toppled


def accelerations(plant: CartPole, x: Array, force: Array) -> tuple[Array, Array]:
    """Of cart (m/s²) and pole (rad/s²) under a horizontal force (N) on the cart, friction included in it.

    With θ to the left and s the cart's position, from the Lagrangian:

        (M + m) s'' - m l cos θ θ'' + m l sin θ θ'² = force
        (I + m l²) θ'' - m l cos θ s'' = m g l sin θ
    """
    ml = plant.pole_mass * plant.pole_centre
    mass, inertia = plant.cart_mass + plant.pole_mass, plant.pole_inertia + ml * plant.pole_centre
    sin, cos = jnp.sin(x[2]), jnp.cos(x[2])
    pushed, turned = force - ml * sin * x[3] ** 2, ml * plant.gravity * sin
    per_det = 1.0 / (mass * inertia - (ml * cos) ** 2)
    return (inertia * pushed + ml * cos * turned) * per_det, (ml * cos * pushed + mass * turned) * per_det


def motion(plant: CartPole, x: Array, force: Array, h: Array) -> Array:
    """One step under a constant force: the classical Runge-Kutta method, with one friction force for the step.

    The friction is the one that would bring the cart to rest by the end of the step, no larger than Coulomb's (Moreau's
    implicit rule), so that a cart at rest stays there as long as the ground can hold it.
    """
    most = plant.friction * (plant.cart_mass + plant.pole_mass) * plant.gravity
    free, _ = accelerations(plant, x, force)
    unit, _ = accelerations(plant, x, force + 1.0)  # what a newton more does
    tried = -(x[1] + h * free) / jnp.where(h > 0, h * (unit - free), 1.0)
    total = force + jnp.clip(tried, -most, most)

    def slope(x: Array) -> Array:
        cart, pole = accelerations(plant, x, total)
        return jnp.stack([x[1], cart, x[3], pole])

    k1 = slope(x)
    k2 = slope(x + 0.5 * h * k1)
    k3 = slope(x + 0.5 * h * k2)
    k4 = slope(x + h * k3)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def feedback(plant: CartPole, x: Array) -> Array:
    """CLEAVE's law from a sampled state [4, N], a force [1, N] (N)."""
    force = jnp.clip(-jnp.asarray(plant.gains, x.dtype) @ x, -plant.max_force, plant.max_force)
    return jnp.where(jnp.abs(x[2]) > plant.give_up_angle, 0.0, force)[None]


def _over(plant: CartPole, length: Array, steps: int) -> Move[CartPoleState]:
    h = length / steps

    def move(state: CartPoleState, command: Array, when: Instant) -> CartPoleState:
        x = jax.lax.fori_loop(0, steps, lambda _, x: motion(plant, x, command[0], h), state.x)
        upright = state.peak < plant.fail_angle
        square = 0.5 * length * (state.x[2] ** 2 + x[2] ** 2)
        peak = jnp.maximum(state.peak, jnp.abs(x[2]))
        return CartPoleState(x, peak, state.square + jnp.where(upright, square, 0.0))

    return move


def simulate_cart_pole(
    plant: CartPole,
    loop_times: ArrayLike,
    *,
    tau: float,
    deadline: float,
    rules: Rules | None = None,
    start: ArrayLike | None = None,
    record: bool = False,
) -> Driven[CartPoleState]:
    """Simulates N carts from given loop times.

    The motion between samples has no closed form. At the default step it is 2e-8 off after half a second without
    friction, and up to 2e-4 (m, rad and per s) with CLEAVE's: the instant at which a cart stops or turns is that of a
    step, and a pole that falls makes ten times of what it is off by in half a second.

    Args:
        plant: Cart, pole and controller.
        loop_times: [P, N] T_net of the loop that starts at t_p (s), inf where lost or where no sample is sent.
        tau: Sampling period (s).
        deadline: Delta (s).
        rules: Actuation and hold (model, section 4), by default `deadline` and `hold`.
        start: [4] or [N, 4] position, speed, angle, angular speed; upright and at rest by default.
        record: Whether the states of every instant are returned too.

    Returns:
        State at the end, what the network did, and if asked for states [P, ...] and forces [P, 1, N]. A pole has
        toppled where `state.peak` has reached `plant.fail_angle`.

    Raises:
        TypeError: An argument is of another kind.
        ValueError: A shape or a sign is wrong; the message names the argument.
    """
    rules = rules or Rules()
    if not isinstance(plant, CartPole):
        raise TypeError(f"plant: got {type(plant).__name__}, expected a CartPole")
    check_timing(loop_times, tau, deadline, rules)
    times = jnp.asarray(loop_times, jnp.result_type(float))
    begin = np.zeros(4) if start is None else _checks.numbers("start", start)
    if np.shape(begin) not in {(4,), (times.shape[1], 4)}:
        raise ValueError(f"start: got shape {np.shape(begin)}, expected (4,) or ({times.shape[1]}, 4)")
    x = jnp.broadcast_to(jnp.asarray(begin, times.dtype), (times.shape[1], 4)).T
    lengths = np.asarray(piece_lengths(deadline, tau, rules)[0])
    steps = tuple(max(1, int(np.ceil(h / plant.step - 1e-6))) for h in lengths)
    slots = room_for(deadline, tau, len(times))
    return _simulate(plant, x, times, float(tau), float(deadline), rules, steps, slots, record)


@partial(jax.jit, static_argnames=("plant", "rules", "steps", "slots", "record"))
def _simulate(
    plant: CartPole,
    x: Array,
    times: Array,
    tau: float,
    deadline: float,
    rules: Rules,
    steps: tuple[int, ...],
    slots: int,
    record: bool,
) -> Driven[CartPoleState]:
    lengths = piece_lengths(deadline, tau, rules)[0]
    moves = tuple(_over(plant, lengths[at], count) for at, count in enumerate(steps))
    prepared = Plant(lambda state: feedback(plant, state.x), moves, 1)
    state = CartPoleState(x, jnp.abs(x[2]), jnp.zeros_like(x[2]))
    key = jax.random.key(0)  # no noise is drawn from it
    return drive(prepared, state, times, tau=tau, deadline=deadline, rules=rules, slots=slots, key=key, record=record)
