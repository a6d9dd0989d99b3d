"""The closed loop of the model: one readable step and one scan over the ticks (model, sections 2 to 5).

Every array ends in the same batch dimensions `*B`: none for one run, designs and seeds for a batch. The step is written
once for both; how a batch is laid out is the business of `qocjax.batch`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import AngleMath
from qocjax.controllers.apf import apf
from qocjax.network.schedule import Rules, Schedule, schedule, split_deadline
from qocjax.quality import Tally
from qocjax.reference import reference_path
from qocjax.scenario import Design, Scenario
from qocjax.unicycle import Command, Pose, arc, pose_from

__all__ = ["Plan", "Recorded", "run_closed_loop"]


@dataclass(frozen=True)
class Plan:
    """What a compiled loop is specialised for.

    Attributes:
        rules: Actuation and hold.
        math: Exact or polynomial functions of angles.
        slots: Capacity of the buffer of commands under way, in ticks.
        mid_tick: Whether commands take effect between sampling instants; None where only the run can tell (a traced
            deadline).
        record: Whether poses and commands of every tick are returned.
    """

    rules: Rules
    math: AngleMath
    slots: int
    mid_tick: bool | None
    record: bool = False


class Recorded(NamedTuple):
    """Trajectory of a run, at the sampling instants."""

    pose: Pose  # each field [P+1, N, *B]
    command: Command  # each field [P, N, *B], in force at t_p after what takes effect at t_p
    reference: tuple[Array, Array]  # each [P+1, 1 or N, *B]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _State:
    """What one tick hands to the next."""

    pose: Pose
    applied: Command  # the command in force, before any hold gain
    under_way: Command  # [slots, N, *B] commands computed in the last ticks, by tick modulo the slots in use
    error: tuple[Array, Array]  # disagreement delta at t_p
    tally: Tally


class _Row(NamedTuple):
    """What one tick takes from outside."""

    tick: Array
    length: Array  # time from t_p to the next sampling instant, or to the horizon (s)
    network: Schedule
    reference_mid: tuple[Array, Array] | None  # at t_p + rest
    reference_end: tuple[Array, Array]


def run_closed_loop(
    scenario: Scenario, design: Design, start: Array, loop_times: Array, plan: Plan
) -> tuple[Tally, Schedule, Recorded | None]:
    """Simulates a batch of runs.

    Args:
        scenario: Goal, reference, weights, horizon; its own start poses are not read.
        design: Values broadcastable to [N, *B]; tau and deadline are scalars.
        start: [N, 3, *B] start poses, broadcastable to the batch.
        loop_times: [P, N, *B'] T_net (s), broadcastable to the batch.
        plan: What the loop is specialised for.

    Returns:
        The totals of each run, the schedule that the network gave, and the trajectory if the plan asks for it.
    """
    tau, deadline = jnp.asarray(design.tau), jnp.asarray(design.deadline)
    lag, rest = split_deadline(deadline, tau)
    mid_tick = rest > 0 if plan.mid_tick is None else plan.mid_tick
    network = schedule(loop_times, deadline, tau, plan.rules, mid_tick)

    num_ticks = loop_times.shape[0]
    instants = jnp.minimum(jnp.arange(num_ticks + 1) * tau, scenario.horizon)
    goal = _per_robot(jnp.asarray(scenario.goal), start)
    path = reference_path(instants, start, goal, scenario, design)
    between = None
    if mid_tick is not False:
        between = reference_path(jnp.minimum(instants[:-1] + rest, scenario.horizon), start, goal, scenario, design)

    pose = jax.tree.map(lambda a: jnp.broadcast_to(a, _batch_shape(start, loop_times, design)), pose_from(start))
    still = Command(jnp.zeros_like(pose.x), jnp.zeros_like(pose.x))
    under_way = jax.tree.map(lambda a: jnp.zeros((plan.slots, *a.shape), a.dtype), still)
    state = _State(pose, still, under_way, (pose.x - path[0][0], pose.y - path[1][0]), Tally.zero(pose))
    goal_xy = (goal[:, 0], goal[:, 1])

    def step(state: _State, row: _Row) -> tuple[_State, tuple[Pose, Command] | None]:
        return _tick(scenario, design, goal_xy, (lag, rest, mid_tick), plan, state, row)

    rows = _Row(jnp.arange(num_ticks), jnp.diff(instants), network, between, (path[0][1:], path[1][1:]))
    state, recorded = lax.scan(step, state, rows)
    tally = state.tally.at_instant(num_ticks, state.pose, goal_xy, design)
    if recorded is None:
        return tally, network, None
    poses = jax.tree.map(lambda each, last: jnp.concatenate([each, last[None]]), recorded[0], state.pose)
    return tally, network, Recorded(poses, recorded[1], path)


def _tick(
    scenario: Scenario,
    design: Design,
    goal: tuple[Array, Array],
    timing: tuple[Array, Array, bool | Array],
    plan: Plan,
    state: _State,
    row: _Row,
) -> tuple[_State, tuple[Pose, Command] | None]:
    """One sampling period: sample and compute, let a command take effect, move; twice where one does so in between."""
    lag, rest, mid_tick = timing
    net = row.network
    tally = state.tally.at_instant(row.tick, state.pose, goal, design)
    command = apf(state.pose, net.age, goal, design, plan.math)
    under_way, due = _exchange(state.under_way, command, row.tick, lag, net.source, plan)

    pose, applied, error = state.pose, state.applied, state.error
    if row.reference_mid is None:  # commands take effect at sampling instants only
        applied = _choose(net.fresh, due, applied)
        first = applied.scaled(net.gain_start)
        pose, error, tally = _move(scenario, pose, error, tally, first, row.length, row.reference_end, plan.math)
    else:
        applied = _choose(net.fresh & jnp.logical_not(mid_tick), due, applied)
        first = applied.scaled(net.gain_start)
        h = jnp.minimum(rest, row.length)
        pose, error, tally = _move(scenario, pose, error, tally, first, h, row.reference_mid, plan.math)
        applied = _choose(net.fresh & mid_tick, due, applied)
        second = applied.scaled(net.gain_mid)
        pose, error, tally = _move(scenario, pose, error, tally, second, row.length - h, row.reference_end, plan.math)
    out = (state.pose, first) if plan.record else None
    return _State(pose, applied, under_way, error, tally), out


def _exchange(
    under_way: Command, command: Command, tick: Array, lag: Array, source: Array, plan: Plan
) -> tuple[Command, Command]:
    """Stores this tick's command and fetches the one that is due: a row of the buffer, or one per robot for `arrival`."""
    if plan.rules.actuation == "instant":
        return under_way, command
    in_use = jnp.minimum(lag + 1 + (plan.rules.actuation == "arrival"), plan.slots)
    under_way = jax.tree.map(
        lambda all_, new: lax.dynamic_update_index_in_dim(all_, new, tick % in_use, 0), under_way, command
    )
    if plan.rules.actuation == "deadline":
        row = (tick - lag) % in_use
        return under_way, jax.tree.map(lambda all_: lax.dynamic_index_in_dim(all_, row, 0, keepdims=False), under_way)
    index = (jnp.maximum(source, 0) % in_use)[None]
    return under_way, jax.tree.map(
        lambda all_: jnp.take_along_axis(all_, jnp.broadcast_to(index, (1, *all_.shape[1:])), axis=0)[0], under_way
    )


def _move(
    scenario: Scenario,
    pose: Pose,
    error: tuple[Array, Array],
    tally: Tally,
    command: Command,
    h: Array,
    reference: tuple[Array, Array],
    math: AngleMath,
) -> tuple[Pose, tuple[Array, Array], Tally]:
    """Moves over a piece of constant command and takes it into the totals."""
    pose = arc(pose, command, h, math)
    next_error = (pose.x - reference[0], pose.y - reference[1])
    return pose, next_error, tally.over_piece(scenario, error, next_error, command, h)


def _choose(fresh: Array, due: Command, held: Command) -> Command:
    return jax.tree.map(lambda new, old: jnp.where(fresh, new, old), due, held)


def _per_robot(goal: Array, start: Array) -> Array:
    """Goals [N, 2, *1], of the rank of the start poses."""
    each = jnp.broadcast_to(goal, (start.shape[0], 2))
    return each.reshape(each.shape + (1,) * (start.ndim - 2))


def _batch_shape(start: Array, loop_times: Array, design: Design) -> tuple[int, ...]:
    leaves = (getattr(design, name) for name in ("v_max", "omega_max", "eta", "kappa", "gamma", "c_miss", "d_safe"))
    return jnp.broadcast_shapes(start[:, 0].shape, loop_times.shape[1:], *(jnp.shape(leaf) for leaf in leaves))
