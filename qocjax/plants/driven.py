"""Any plant in the loop: the timing that robots have, around motion and feedback of one's own.

Loop completion, actuation, hold and the commands under way are the kernels of the robots (`network.schedule`,
`pipeline`); a plant says how it moves over a piece of constant command, and what is sent to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.network.schedule import Rules, Schedule, schedule, split_deadline
from qocjax.pipeline import Loop, through_buffer

__all__ = ["Driven", "Instant", "Move", "Plant", "check_timing", "drive", "piece_lengths", "room_for"]

_USUAL_SLOTS = 16

State = TypeVar("State")


class Instant(NamedTuple):
    """The sampling period that a piece of motion is in."""

    tick: Array
    key: Array  # for noise; of this period, and so of all its pieces


Move = Callable[[State, Array, Instant], State]
"""State, command in force [m, N] and sampling period, to the state at the end of the piece."""


@dataclass(frozen=True)
class Plant(Generic[State]):
    """What is controlled, and its feedback; N of them at once, each with a loop of its own.

    Components come first: a command is [m, N].

    Attributes:
        feedback: From the state sampled at t_p to the command [m, N].
        moves: Motion over each of the pieces of a sampling period, whose lengths `piece_lengths` tells.
        inputs: Number m of components of a command.
    """

    feedback: Callable[[State], Array]
    moves: tuple[Move[State], ...]
    inputs: int


class Driven(NamedTuple, Generic[State]):
    """What came of a run; leaves of states are [..., N], and recorded ones [P, ..., N]."""

    state: State  # at the end
    network: Schedule
    recorded: tuple[State, Array] | None  # states at t_p, commands [P, m, N] in force from t_p on


class _Carry(NamedTuple):
    state: Any
    applied: Array  # [m, N], before any hold gain


class _Row(NamedTuple):
    network: Schedule
    instant: Instant


def drive(
    plant: Plant[State],
    state: State,
    loop_times: Array,
    *,
    tau: Array | float,
    deadline: Array | float,
    rules: Rules,
    slots: int,
    key: Array,
    record: bool = False,
) -> Driven[State]:
    """Runs N plants over P sampling periods; works under `jax.jit` and `jax.vmap`.

    Args:
        plant: Motion and feedback, prepared for `tau`, `deadline` and `rules`.
        state: At t_0, leaves [..., N].
        loop_times: [P, N] T_net (s), inf where lost.
        tau: Sampling period (s).
        deadline: Delta (s).
        rules: Actuation and hold.
        slots: Capacity of the buffer of commands under way, see `room_for`.
        key: Random key of the noise.
        record: Whether states and commands of every tick are returned.
    """
    lag, rest = split_deadline(jnp.asarray(deadline), jnp.asarray(tau))
    between = rules.actuation == "deadline"
    mid_tick = rest > 0 if between else jnp.asarray(False)
    network = schedule(loop_times, deadline, tau, rules, mid_tick)
    ticks = jnp.arange(loop_times.shape[0])
    keys = jax.vmap(lambda tick: jax.random.fold_in(key, tick))(ticks)
    first, *others = plant.moves

    def sample(carry: _Carry, row: _Row) -> tuple[_Carry, Array, None]:
        return carry, plant.feedback(carry.state), None

    def act(carry: _Carry, row: _Row, due: Array) -> tuple[_Carry, Any]:
        net = row.network
        applied = _choose(net.fresh & jnp.logical_not(mid_tick), due, carry.applied)
        command = _scaled(applied, net.gain_start)
        state = first(carry.state, command, row.instant)
        for second in others:
            applied = _choose(net.fresh & mid_tick, due, applied)
            state = second(state, _scaled(applied, net.gain_mid), row.instant)
        # A first piece without length has no command to show: what counts from t_p on is that of the second.
        shown = jnp.where(mid_tick, command, _scaled(applied, net.gain_mid if between else net.gain_start))
        return _Carry(state, applied), (carry.state, shown) if record else None

    still = jnp.zeros((plant.inputs, loop_times.shape[1]), loop_times.dtype)
    loop = Loop(sample, act, still)
    rows = _Row(network, Instant(ticks, keys))
    end, recorded = through_buffer(loop, _Carry(state, still), rows, network.source, lag, rules, slots)
    return Driven(end.state, network, None if recorded is None else recorded[:2])


def piece_lengths(deadline: ArrayLike, tau: float, rules: Rules) -> Array:
    """Lengths (s) of the pieces of a sampling period, [D, 2] or, where commands only take effect at t_p, [D, 1].

    A deadline [D] that is a multiple of tau gives a first piece of length 0.
    """
    deadlines = jnp.atleast_1d(jnp.asarray(deadline, jnp.result_type(float)))
    if rules.actuation != "deadline":
        return jnp.full((deadlines.shape[0], 1), tau)
    _, rest = split_deadline(deadlines, jnp.asarray(tau))
    return jnp.stack([rest, tau - rest], axis=1)


def room_for(deadline: ArrayLike, tau: float, ticks: int) -> int:
    """Buffer that suffices for deadlines (s); a power of two, so that many of them share one program."""
    lags = [int(split_deadline(float(each), tau)[0]) for each in np.ravel(np.asarray(deadline))]
    return min(max(_USUAL_SLOTS, 1 << (min(max(lags), ticks) + 1).bit_length()), ticks + 2)


def check_timing(loop_times: ArrayLike, tau: float, deadline: ArrayLike, rules: Rules) -> None:
    """Checks what every plant is driven by.

    Raises:
        TypeError: An argument is of another kind.
        ValueError: Loop times are not [P, N], negative or NaN; tau is not positive, a deadline negative; the rules ask
            for plans.
    """
    if not isinstance(rules, Rules):
        raise TypeError(f"rules: got {type(rules).__name__}, expected Rules")
    rules.check_single("a plant's feedback makes one command")
    _checks.bounded("tau", tau, above=0.0, shape=())
    _checks.bounded("deadline", deadline, least=0.0)
    if np.ndim(loop_times) != 2 or 0 in np.shape(loop_times):
        raise ValueError(f"loop_times: got shape {np.shape(loop_times)}, expected (ticks, loops)")
    values = np.asarray(loop_times)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"loop_times: got values of type {values.dtype}, expected seconds (inf where lost)")
    if np.isnan(values).any() or (values < 0).any():
        raise ValueError("loop_times: got NaN or a negative time, expected seconds >= 0 (inf where lost)")


def _choose(fresh: Array, due: Array, held: Array) -> Array:
    return jnp.where(fresh[None], due, held)


def _scaled(command: Array, gain: Array | None) -> Array:
    return command if gain is None else command * gain[None]
