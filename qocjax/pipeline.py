"""Commands on their way: how a scan over ticks hands each command to the tick in which it takes effect.

Two ways with one result. Through a buffer of the last commands: for any deadline, known only at run time, and the
faster way forward. In blocks of as many ticks as a deadline has sampling periods: what takes effect within a block was
computed in the one before, so there is no buffer to update, and reverse-mode differentiation keeps and copies little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.schedule import Rules

__all__ = ["Loop", "block_length", "in_blocks", "through_buffer"]

# Ticks of a block where nothing is under way, so that any number will do.
_FREE_BLOCK = 64


# Pytrees of arrays: what is simulated and what steers it are the caller's affair.
State = TypeVar("State")
Command = TypeVar("Command")


@dataclass(frozen=True)
class Loop(Generic[State, Command]):
    """The two halves of a tick, in any state and for any command.

    Attributes:
        sample: (state, row) -> (state, command, view): what happens at t_p up to the new command, and what may be
            recorded of it.
        act: (state, row, due command) -> (state, report): the due command takes effect, the robots move; a report of
            None records nothing.
        still: A command of zeros, for before the first; leaves [..., N, *B].
    """

    sample: Callable[[State, Any], tuple[State, Command, Any]]
    act: Callable[[State, Any, Command], tuple[State, Any]]
    still: Command


def through_buffer(
    loop: Loop[State, Command],
    state: State,
    rows: Any,
    source: Array,
    lag: Array,
    rules: Rules,
    slots: int,
    last: Array | None = None,
) -> tuple[State, Any]:
    """Scans the ticks with a buffer of commands, by tick modulo the slots in use.

    Args:
        loop: The tick.
        state: At the start.
        rows: What each tick takes from outside; leaves [P, ...].
        source: [P, N, *B'] loop whose command is in force after each tick's change.
        lag: Whole sampling periods of the deadline.
        rules: The actuation says which command is due: the one of `lag` ticks ago, the newest arrived, or this tick's.
        slots: Capacity, at least lag + 1, and one more for `arrival`.
        last: Ticks that are run, if that is known only at run time, which leaves no reports; by default all.

    Returns:
        The state at the end, and the reports of all ticks with their views.
    """
    in_use = jnp.minimum(lag + 1 + (rules.actuation == "arrival"), slots)
    buffer = jax.tree.map(lambda a: jnp.zeros((slots, *a.shape), a.dtype), loop.still)

    def exchange(buffer: Command, command: Command, tick: Array, newest: Array) -> tuple[Command, Command]:
        if rules.actuation == "instant":
            return buffer, command
        put = lambda kept, new: lax.dynamic_update_index_in_dim(kept, new, tick % in_use, 0)  # noqa: E731
        buffer = jax.tree.map(put, buffer, command)
        if rules.actuation == "deadline":
            place = (tick - lag) % in_use
            return buffer, jax.tree.map(lambda kept: lax.dynamic_index_in_dim(kept, place, 0, keepdims=False), buffer)
        place = (jnp.maximum(newest, 0) % in_use)[None]
        return buffer, jax.tree.map(
            lambda kept: jnp.take_along_axis(kept, jnp.broadcast_to(place, (1, *kept.shape[1:])), axis=0)[0], buffer
        )

    def step(carry: tuple[State, Command], inputs: tuple[Array, Array, Any]) -> tuple[tuple[State, Command], Any]:
        (state, buffer), (tick, newest, row) = carry, inputs
        state, command, view = loop.sample(state, row)
        buffer, due = exchange(buffer, command, tick, newest)
        state, report = loop.act(state, row, due)
        return (state, buffer), None if report is None else (*report, view)

    inputs = (jnp.arange(source.shape[0], dtype=jnp.int32), source, rows)
    if last is None:
        (state, _), reports = lax.scan(step, (state, buffer), inputs)
        return state, reports

    def nth(tick: Array, carry: tuple[State, Command]) -> tuple[State, Command]:
        at = jax.tree.map(lambda a: lax.dynamic_index_in_dim(a, tick, 0, keepdims=False), inputs)
        return step(carry, at)[0]

    return lax.fori_loop(0, last, nth, (state, buffer))[0], None


def in_blocks(loop: Loop[State, Command], state: State, rows: Any, lag: int) -> State:
    """Scans blocks of `lag` ticks, each computed again where it is differentiated in reverse.

    Args:
        loop: The tick.
        state: At the start.
        rows: What each tick takes from outside; leaves [P, ...], P a multiple of `block_length(lag)`.
        lag: Sampling periods after which a command takes effect; 0 within its own tick.

    Returns:
        The state at the end.
    """

    def tick(state: State, inputs: tuple[Any, Command | None]) -> tuple[State, Command | None]:
        row, due = inputs
        state, command, _ = loop.sample(state, row)
        state, _ = loop.act(state, row, command if due is None else due)
        return state, None if due is None else command

    def block(carry: tuple[State, Command | None], rows: Any) -> tuple[tuple[State, Command | None], None]:
        state, due = carry
        return lax.scan(jax.checkpoint(tick, prevent_cse=False), state, (rows, due)), None

    length = block_length(lag)
    none_yet = jax.tree.map(lambda a: jnp.zeros((length, *a.shape), a.dtype), loop.still) if lag else None
    blocks = jax.tree.map(lambda a: a.reshape(a.shape[0] // length, length, *a.shape[1:]), rows)
    (state, _), _ = lax.scan(jax.checkpoint(block, prevent_cse=False), (state, none_yet), blocks)
    return state


def block_length(lag: int) -> int:
    """Ticks of a block."""
    return lag or _FREE_BLOCK
