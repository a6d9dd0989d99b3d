"""What happens at an edge that has too few workers: one scan over the arrivals for each discipline (model, section 12).

Times are kept relative to the arrival at hand, so that late in a run they are as exact as at its beginning: what each
worker still has to do, how long each place has waited. `*B` is any batch, `W` workers, `N` robots that share them.
Times closer than `slack` (s) are one instant. `idle` [W, *1] is what each worker has to do at first, 0, or inf for none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

__all__ = ["DISCIPLINES", "Work"]

_NO_TURN = jnp.iinfo(jnp.int32).max


class Work(NamedTuple):
    """Samples in the order of their arrival; what is the same in a part of the batch may have length 1 there."""

    gap: Array  # [M, 1, *B] s since the arrival before
    robot: Array  # [M, 1, *B] whose it is
    tick: Array  # [M, 1, *B] at which it was sampled
    compute: Array  # [M, 1, *B] s of a worker
    limit: Array  # [M, 1, *B] s from the arrival until it is given up; inf for never, 0 where it takes nothing


def skip(work: Work, idle: Array, num_robots: int, slack: Array) -> Array:
    """Waiting times [M, 1, *B] (s): 0, or inf where no worker is idle."""

    def arrive(busy: Array, sample: Work) -> tuple[Array, Array]:
        busy = _after(busy, sample.gap, slack)
        serves = (_least(busy) <= 0.0) & (sample.limit > 0.0)
        busy = _given(busy, serves, jnp.minimum(sample.compute, sample.limit))
        return busy, jnp.where(serves, 0.0, jnp.inf)

    return lax.scan(arrive, _spread(work, idle), work)[1]


def fifo(work: Work, idle: Array, num_robots: int, slack: Array) -> Array:
    """Waiting times [M, 1, *B] (s); inf for a sample that is given up while it waits."""

    def arrive(busy: Array, sample: Work) -> tuple[Array, Array]:
        busy = _after(busy, sample.gap, slack)
        wait = _least(busy)
        serves = sample.limit - wait > slack
        busy = _given(busy, serves, wait + jnp.minimum(sample.compute, sample.limit - wait))
        return busy, jnp.where(serves, wait, jnp.inf)

    return lax.scan(arrive, _spread(work, idle), work)[1]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Places:
    """One place to wait for each robot, and what became of its latest sample."""

    busy: Array  # [W, *B] s that each worker still has to do
    turn: Array  # [N, *B] by which places are served; _NO_TURN where empty
    waited: Array  # [N, *B] s
    compute: Array  # [N, *B] s
    limit: Array  # [N, *B] s until it is given up
    tick: Array  # [N, *B] at which the sample there was taken
    place: Array  # [N, *B] of the robot's latest sample in the order of arrival; M before the first
    outcome: Array  # [N, *B] s that it waited; inf until it is served


def latest(work: Work, idle: Array, num_robots: int, slack: Array) -> Array:
    """Waiting times [M, 1, *B] (s); inf for a sample that a newer one replaced, or that was given up while it waited.

    Newer is what was sampled later.
    """
    length, busy = work.gap.shape[0], _spread(work, idle)
    empty = jnp.zeros((num_robots, *busy.shape[1:]), busy.dtype)
    whole = jnp.zeros(empty.shape, jnp.int32)
    begin = _Places(busy, whole + _NO_TURN, empty, empty, empty, whole, whole + length, empty + jnp.inf)

    def arrive(state: _Places, row: tuple[Array, Work]) -> tuple[_Places, tuple[Array, Array]]:
        number, sample = row
        state = _advanced(_served_until(state, sample.gap, slack), sample.gap, slack)
        own = _one_hot(sample.robot, num_robots) & (sample.limit > 0.0)
        own &= (state.turn == _NO_TURN) | (state.tick < sample.tick)  # an older one that comes late is lost
        known = _of(own, state.place, length), _of(own, state.outcome, jnp.inf)
        return _arrived(state, own, number, sample), known

    state, (places, waits) = lax.scan(arrive, begin, (jnp.arange(length, dtype=jnp.int32), work))
    state = _served_until(state, jnp.full_like(empty[:1], jnp.inf), slack)
    places, waits = (
        jnp.concatenate([each[:, 0], last]) for each, last in ((places, state.place), (waits, state.outcome))
    )
    index = jnp.indices(places.shape, sparse=True)[1:]
    found = jnp.full((length, *empty.shape[1:]), jnp.inf, empty.dtype).at[(places, *index)].set(waits, mode="drop")
    return found[:, None]


DISCIPLINES: dict[str, Callable[[Work, Array, int, Array], Array]] = {"skip": skip, "latest": latest, "fifo": fifo}


def _served_until(state: _Places, gap: Array, slack: Array) -> _Places:
    """Lets workers that become idle by `gap` from now take the places whose turn it is."""

    def some(state: _Places) -> Array:
        return jnp.any(_starts(state, gap, slack)[0])

    def serve(state: _Places) -> _Places:
        starts, at, first = _starts(state, gap, slack)
        chosen = first & starts
        compute, limit = (_of(chosen, values, jnp.inf) for values in (state.compute, state.limit))
        return replace(
            state,
            busy=_given(state.busy, starts, at + jnp.minimum(compute, limit - at)),
            turn=jnp.where(chosen, _NO_TURN, state.turn),
            outcome=jnp.where(chosen, state.waited + at, state.outcome),
        )

    return lax.while_loop(some, serve, state)


def _starts(state: _Places, gap: Array, slack: Array) -> tuple[Array, Array, Array]:
    """Whether a place is served next, when (s from now), and which one."""
    at = _least(state.busy)
    turn = jnp.where(state.limit - at > slack, state.turn, _NO_TURN)  # what is given up by then has left
    return (_least(turn) < _NO_TURN) & (at <= gap + slack), at, _smallest(turn)


def _advanced(state: _Places, gap: Array, slack: Array) -> _Places:
    """Lets time pass in which no place is served; what is given up leaves."""
    limit = state.limit - gap
    return replace(
        state,
        busy=_after(state.busy, gap, slack),
        waited=state.waited + gap,
        limit=limit,
        turn=jnp.where(limit > slack, state.turn, _NO_TURN),
    )


def _arrived(state: _Places, own: Array, number: Array, sample: Work) -> _Places:
    """A sample takes an idle worker, or the place of its robot with the turn that it has."""
    serves = _least(state.busy) <= 0.0
    turn = jnp.where(serves, _NO_TURN, jnp.minimum(state.turn, number))
    used = serves & own.any(axis=0, keepdims=True)
    return _Places(
        busy=_given(state.busy, used, jnp.minimum(sample.compute, sample.limit)),
        turn=jnp.where(own, turn, state.turn),
        waited=jnp.where(own, 0.0, state.waited),
        compute=jnp.where(own, sample.compute, state.compute),
        limit=jnp.where(own, sample.limit, state.limit),
        tick=jnp.where(own, sample.tick, state.tick),
        place=jnp.where(own, number, state.place),
        outcome=jnp.where(own, jnp.where(serves, 0.0, jnp.inf), state.outcome),
    )


def _spread(work: Work, idle: Array) -> Array:
    """What each worker [W, *1] still has to do at first, over the batch."""
    batch = jnp.broadcast_shapes(*(values.shape[2:] for values in work))
    return jnp.broadcast_to(idle, (idle.shape[0], *batch))


def _after(busy: Array, gap: Array, slack: Array) -> Array:
    """What workers still have to do after a time; rest of rounding is none."""
    left = busy - gap
    return jnp.where(left > slack, left, 0.0)


def _given(busy: Array, serves: Array, seconds: Array) -> Array:
    """The worker that is idle first is busy for so long from now, where one serves."""
    return jnp.where(_smallest(busy) & serves, seconds, busy)


def _least(values: Array) -> Array:
    return values.min(axis=0, keepdims=True)


def _smallest(values: Array) -> Array:
    """One-hot of the first smallest along the first axis."""
    return _one_hot(jnp.argmin(values, axis=0, keepdims=True), values.shape[0])


def _one_hot(index: Array, length: int) -> Array:
    """Which row each index [1, *B] means, [length, *B]."""
    return jnp.arange(length, dtype=index.dtype).reshape((-1,) + (1,) * (index.ndim - 1)) == index


def _of(chosen: Array, values: Array, nothing: float | int) -> Array:
    """The value of the row that is chosen, [1, *B]; `nothing`, which no value exceeds, where none is."""
    return _least(jnp.where(chosen, values, jnp.asarray(nothing, values.dtype)))
