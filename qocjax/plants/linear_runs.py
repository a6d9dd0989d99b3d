"""Runs of a linear plant under random loop times: `simulate_linear`, `evaluate_linear`.

They are there for truth: the mean quadratic cost of such a loop is known in closed form (a jump linear system; Costa,
Fragoso and Marques, "Discrete-Time Markov Jump Linear Systems", 2005; as Jitterbug computes it: Lincoln and Cervin, CDC
2002), so that the kernels of timing, actuation and hold can be held against it.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.network.interface import Network, loop_times
from qocjax.network.schedule import Rules
from qocjax.plants.driven import check_timing, drive, piece_lengths, room_for
from qocjax.plants.linear import LinearPlant, LinearState, begin, in_pieces, prepared
from qocjax.plants.pieces import Piece
from qocjax.scenario import num_ticks

__all__ = ["LinearRun", "evaluate_linear", "simulate_linear"]


class LinearRun(NamedTuple):
    """One recorded run of N loops."""

    time: Array  # [P+1] s
    state: Array  # [P+1, N, n]
    command: Array  # [P, N, m], in force at t_p, after what takes effect at t_p
    age: Array  # [P, N] s, of the command in force at t_p
    completed: Array  # [P, N] whether the loop that starts at t_p completes
    cost: Array  # [P+1, N], ∫ x'Qx + u'Ru up to t_p, the mean over the noise between samples


def simulate_linear(
    plant: LinearPlant,
    loop_times: ArrayLike,
    *,
    tau: float,
    deadline: float,
    rules: Rules | None = None,
    start: ArrayLike | None = None,
    key: Array | None = None,
) -> LinearRun:
    """Simulates N loops of a linear plant from given loop times, with their trajectories.

    Motion, noise and cost between changes of the command are exact, also where a deadline puts one between two samples.
    The cost of a piece is its mean over the noise within, given where the piece begins.

    Args:
        plant: Motion, feedback, cost and noise.
        loop_times: [P, N] T_net of the loop that starts at t_p (s), inf where lost.
        tau: Sampling period (s).
        deadline: Delta (s).
        rules: Actuation and hold (model, section 4), by default `deadline` and `hold`.
        start: [n] state at t_0 of all loops, or [N, n]; zeros by default.
        key: Random key of the noise; `jax.random.key(0)` by default.

    Raises:
        TypeError: An argument is of another kind.
        ValueError: A shape or a sign is wrong; the message names the argument.
    """
    rules = rules or Rules()
    check_timing(loop_times, tau, deadline, rules)
    times = jnp.asarray(loop_times, jnp.result_type(float))
    checked, state = begin(plant, start, times.shape[1])
    key = jax.random.key(0) if key is None else key
    found = jax.tree.map(lambda each: each[0], in_pieces(checked, piece_lengths(deadline, tau, rules)))
    slots = room_for(deadline, tau, len(times))
    return _simulate(checked.k, found, state, times, float(tau), float(deadline), key, rules, slots)


def evaluate_linear(
    plant: LinearPlant,
    network: Network,
    seeds: ArrayLike,
    *,
    tau: float,
    deadline: ArrayLike,
    horizon: float,
    rules: Rules | None = None,
    start: ArrayLike | None = None,
    warm_up: float = 0.0,
    loops: int = 1,
) -> xr.Dataset:
    """Mean cost per second over deadlines and seeds, on common random numbers.

    Args:
        plant: Motion, feedback, cost and noise.
        network: Where loop times come from.
        seeds: [S] whole numbers.
        tau: Sampling period (s).
        deadline: Delta (s), one or [D].
        horizon: Simulated time T (s), rounded up to whole sampling periods.
        rules: Actuation and hold, by default `deadline` and `hold`.
        start: [n] state at t_0; zeros by default.
        warm_up: Time at the beginning that does not count (s), rounded to whole sampling periods.
        loops: Number N of loops on the network.

    Returns:
        `cost` and `completed_share` over deadline, seed and loop; a cost that has left all bounds is inf or nan.

    Raises:
        TypeError: An argument is of another kind.
        ValueError: A shape or a sign is wrong; the message names the argument.
    """
    rules = rules or Rules()
    deadlines = np.atleast_1d(np.asarray(_checks.bounded("deadline", deadline, least=0.0), float))
    ticks = num_ticks(float(_checks.bounded("horizon", horizon, above=0.0, shape=())), tau)
    check_timing(np.zeros((ticks, loops)), tau, deadlines, rules)
    _checks.bounded("warm_up", warm_up, least=0.0, shape=())
    if (skipped := round(warm_up / tau)) >= ticks:
        raise ValueError(f"warm_up: got {warm_up:g} s, expected less than the horizon of {horizon:g} s")
    checked, state = begin(plant, start, loops)
    numbers = _checks.counts("seeds", seeds)
    keys = jax.vmap(lambda seed: jax.random.split(jax.random.key(seed)))(jnp.asarray(numbers, jnp.uint32))
    contended = getattr(network, "uses_deadline", False)
    times = [loop_times(network, keys[:, 0], ticks, loops, tau, each) for each in (deadlines if contended else [None])]
    stacked = jnp.broadcast_to(jnp.stack(times), (len(deadlines), *times[0].shape))
    found, slots = in_pieces(checked, piece_lengths(deadlines, tau, rules)), room_for(deadlines, tau, ticks)
    cost, share = _evaluate(checked.k, found, state, stacked, float(tau), deadlines, keys[:, 1], skipped, rules, slots)
    dims = ("deadline", "seed", "loop")
    data = {"cost": (dims, np.asarray(cost)), "completed_share": (dims, np.asarray(share))}
    return xr.Dataset(data, {"deadline": deadlines, "seed": numbers})


@partial(jax.jit, static_argnames=("rules", "slots"))
def _simulate(
    k: Array,
    found: Piece,
    state: LinearState,
    times: Array,
    tau: float,
    deadline: float,
    key: Array,
    rules: Rules,
    slots: int,
) -> LinearRun:
    plant = prepared(k, found, 0)
    run = drive(plant, state, times, tau=tau, deadline=deadline, rules=rules, slots=slots, key=key, record=True)
    assert run.recorded is not None  # asked for; for the type checker
    states, command = run.recorded
    x = jnp.concatenate([states.x, run.state.x[None]]).swapaxes(1, 2)
    cost = jnp.concatenate([states.cost, run.state.cost[None]])
    time = jnp.arange(times.shape[0] + 1) * tau
    return LinearRun(time, x, command.swapaxes(1, 2), run.network.age, run.network.completed, cost)


@partial(jax.jit, static_argnames=("rules", "slots"))
def _evaluate(
    k: Array,
    found: Piece,
    state: LinearState,
    times: Array,
    tau: float,
    deadlines: Array,
    keys: Array,
    warm_up: int,
    rules: Rules,
    slots: int,
) -> tuple[Array, Array]:
    """Mean cost per second and share of completed loops, each [D, S, N]."""
    seconds = (times.shape[2] - warm_up) * tau

    def one(found: Piece, times: Array, deadline: Array, key: Array) -> tuple[Array, Array]:
        plant = prepared(k, found, warm_up)
        run = drive(plant, state, times, tau=tau, deadline=deadline, rules=rules, slots=slots, key=key)
        return run.state.cost / seconds, jnp.mean(run.network.completed, axis=0, dtype=times.dtype)

    return jax.vmap(jax.vmap(one, (None, 0, None, 0)), (0, 0, 0, None))(found, times, deadlines, keys)
