"""The closed loop of the model: one readable tick and one scan over the ticks (model, sections 2 to 5).

Every array ends in the same batch dimensions `*B`: none for one run, designs and seeds for a batch. The tick is written
once for both; how a batch is laid out is the business of `qocjax.batch`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from qocjax._math import AngleMath
from qocjax.controllers import Apf, Controller, PlanMaker, Sight, Task, plan_of
from qocjax.network.schedule import Rules, Schedule, schedule, split_deadline
from qocjax.packets import Replayed, UnderWay, following, in_force, none_under_way
from qocjax.pipeline import Loop, block_length, in_blocks, through_buffer
from qocjax.quality import Tally
from qocjax.reference import reference_path
from qocjax.robots import Command, Pose, pose_from
from qocjax.scenario import CONTINUOUS, Design, Scenario

__all__ = ["Outcome", "Plan", "Recorded", "run_closed_loop"]


@dataclass(frozen=True)
class Plan:
    """What a compiled loop is specialised for.

    Attributes:
        rules: Actuation and hold.
        math: Exact or polynomial functions of angles.
        slots: Capacity of the buffer of commands under way, in ticks; 0 to scan in blocks of `lag` ticks without one.
        mid_tick: Whether commands take effect between sampling instants; None where only the run can tell (a traced
            deadline).
        record: Whether poses and commands of every tick are returned.
        lag: Whole sampling periods of the deadline; read where there is no buffer.
        controller: What computes the commands.
    """

    rules: Rules
    math: AngleMath
    slots: int
    mid_tick: bool | None
    record: bool = False
    lag: int = 0
    controller: Controller = field(default_factory=Apf)


class Recorded(NamedTuple):
    """Trajectory of a run, at the sampling instants."""

    pose: Pose  # each field [P+1, N, *B]
    command: Command  # each field [P, N, *B], in force at t_p after what takes effect at t_p
    speed: Command  # each field [P, N, *B], driven at t_p; the command where it is obeyed at once
    reference: tuple[Array, Array]  # each [P+1, 1 or N, *B]
    view: Any  # what the controller records of each instant; leaves [P, ...]


class Outcome(NamedTuple):
    """What a batch of runs came to."""

    tally: Tally  # totals
    network: Schedule  # what the network gave
    report: dict[str, Array]  # the controller's numbers, each [N, *B]
    recorded: Recorded | None  # if the plan asks for it


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _State:
    """What one tick hands to the next."""

    pose: Pose
    applied: Command  # the command in force, before any hold gain; the packet, [M, N, *B], where commands are plans
    speed: Command | None  # at which the robot drives at t_p, None where nothing reads it; the last command if obeyed
    error: tuple[Array, Array]  # disagreement delta at t_p
    tally: Tally
    memory: Any  # the controller's
    under_way: UnderWay | Replayed | None  # what was sent, where a plan is to begin from the predicted pose


class _Row(NamedTuple):
    """What one tick takes from outside."""

    tick: Array
    length: Array  # time from t_p to the next sampling instant, or to the horizon (s)
    network: Schedule
    reference_mid: tuple[Array, Array] | None  # at t_p + rest
    reference_end: tuple[Array, Array]


def run_closed_loop(
    scenario: Scenario, design: Design, start: Array, loop_times: Array, plan: Plan, keys: Array | None = None
) -> Outcome:
    """Simulates a batch of runs.

    Args:
        scenario: Goal, reference, weights, horizon; its own start poses are not read.
        design: Values broadcastable to [N, *B]; tau and deadline are scalars.
        start: [N, 3, *B] start poses, broadcastable to the batch.
        loop_times: [P, N, *B'] T_net (s), broadcastable to the batch.
        plan: What the loop is specialised for.
        keys: [*B, 2] words of a random key for each run, for controllers that draw.
    """
    loop_times = _whole_blocks(loop_times, plan)
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
    # Not as differences of instants: in float32 those are off by 1e-4 of a tick late in a run.
    lengths = jnp.clip(scenario.horizon - instants[:-1], 0.0, tau)
    rows = _Row(jnp.arange(num_ticks), lengths, network, between, (path[0][1:], path[1][1:]))

    pose = jax.tree.map(lambda a: jnp.broadcast_to(a, _batch_shape(start, loop_times, design)), pose_from(start))
    still = scenario.robot.still(pose)
    task = Task((goal[:, 0], goal[:, 1]), design, plan.math, num_ticks, lag, rest, plan.slots, scenario.robot)
    memory = plan.controller.begin(task, pose, keys)
    kept = still if scenario.robot.remembers or plan.controller.sees_speed else None
    packet, under_way = still, None
    if plan.rules.plan_length is not None:
        packet = jax.tree.map(lambda a: jnp.zeros((plan.rules.plan_length, *a.shape), a.dtype), still)
        if plan.rules.actuation == "deadline" and not isinstance(plan.controller, PlanMaker):
            under_way = none_under_way(task, pose, plan.lag)
    error = (pose.x - path[0][0], pose.y - path[1][0])
    state = _State(pose, packet, kept, error, Tally.zero(pose), memory, under_way)
    tick = _Tick(scenario, task, mid_tick, plan)
    loop = Loop(tick.sample, tick.act, packet)
    if plan.slots == 0:
        state, recorded = in_blocks(loop, state, rows, plan.lag), None
    else:
        state, recorded = through_buffer(loop, state, rows, network.source, lag, plan.rules, plan.slots)
    tally = state.tally.at_instant(num_ticks, state.pose, task.goal, design)
    report = plan.controller.report(state.memory)
    if recorded is None:
        return Outcome(tally, network, report, None)
    poses = jax.tree.map(lambda each, last: jnp.concatenate([each, last[None]]), recorded[0], state.pose)
    return Outcome(tally, network, report, Recorded(poses, recorded[1], recorded[2], path, recorded[3]))


@dataclass(frozen=True)
class _Tick:
    """One sampling period in two halves: sample and compute; let a command take effect and move."""

    scenario: Scenario
    task: Task
    mid_tick: bool | Array
    plan: Plan

    def sample(self, state: _State, row: _Row) -> tuple[_State, Command, Any]:
        """Reads the poses at t_p and computes the new command."""
        tally = state.tally.at_instant(row.tick, state.pose, self.task.goal, self.task.design)
        sight = Sight(row.tick, state.pose, row.network.age, state.speed)
        if (length := self.plan.rules.plan_length) is None:
            memory, command, view = self.plan.controller.command(self.task, state.memory, sight)
            return replace(state, tally=tally, memory=memory), command, view
        under_way = state.under_way
        if under_way is not None:
            sight = sight._replace(begin=under_way.predicted(self.task, state.pose, state.speed))
        memory, packet, view = plan_of(self.plan.controller, self.task, state.memory, sight, length)
        if under_way is not None:
            under_way = under_way.sent(self.task, in_force(packet))
        return replace(state, tally=tally, memory=memory, under_way=under_way), packet, view

    def act(self, state: _State, row: _Row, due: Command) -> tuple[_State, Any]:
        """The due command takes effect if its loop completed; the robots move, in two pieces where that is between.

        That is at t_p + rest, where the deadline is no multiple of tau.
        """
        net = row.network
        if state.under_way is not None:
            state = replace(state, under_way=state.under_way.due(self.task, in_force(due)))
        if row.reference_mid is None:
            applied = self._choose(net.fresh, due, state.applied, True)
            first = self._driven(applied, net.gain_start)
            moved = self._move(state, applied, first, row.length, row.reference_end)
        else:
            applied = self._choose(net.fresh, due, state.applied, jnp.logical_not(self.mid_tick))
            first = self._driven(applied, net.gain_start)
            h = jnp.minimum(self.task.rest, row.length)
            halfway = self._move(state, applied, first, h, row.reference_mid)
            applied = self._choose(net.fresh, due, applied, self.mid_tick)
            second = self._driven(applied, net.gain_mid)
            moved = self._move(halfway, applied, second, row.length - h, row.reference_end)
        if not self.plan.record:
            return moved, None
        return moved, (state.pose, first, state.speed if self.scenario.robot.remembers else first)

    def _choose(self, fresh: Array, due: Command, held: Command, now: bool | Array) -> Command:
        """What is in force after an instant at which commands take effect, if this is one."""
        if self.plan.rules.plan_length is None:
            return _where(fresh if now is True else fresh & now, due, held)
        return _where(now, following(fresh, due, held), held)

    def _driven(self, applied: Command, gain: Array | None) -> Command:
        """The command that the robots follow."""
        return (applied if self.plan.rules.plan_length is None else in_force(applied)).scaled(gain)

    def _move(
        self, state: _State, applied: Command, command: Command, h: Array, reference: tuple[Array, Array]
    ) -> _State:
        """Moves under a constant command and takes each piece of the motion into the totals."""
        pieces = self.scenario.robot.move(state.pose, state.speed, command, h, self.plan.math)
        path = [reference] if len(pieces) == 1 else _straight(state, reference, h, [each.duration for each in pieces])
        state = replace(state, applied=applied)
        for piece, (x, y) in zip(pieces, path, strict=True):
            error = (piece.pose.x - x, piece.pose.y - y)
            tally = state.tally.over_piece(self.scenario, (state.error, error), state.pose, piece)
            speed = None if state.speed is None else piece.speed
            state = replace(state, pose=piece.pose, speed=speed, error=error, tally=tally)
        return state


def _straight(
    state: _State, reference: tuple[Array, Array], h: Array, durations: Sequence[Array]
) -> list[tuple[Array, Array]]:
    """The reference at the end of each piece of a motion: over all of them together it counts as straight."""
    start = (state.pose.x - state.error[0], state.pose.y - state.error[1])
    left, per_second, found = h, 1.0 / jnp.where(h > 0, h, 1.0), []
    for duration in durations:
        left = left - duration
        share = left * per_second
        x, y = (last - share * (last - first) for first, last in zip(start, reference, strict=True))
        found.append((x, y))
    return found


def _whole_blocks(loop_times: Array, plan: Plan) -> Array:
    """Loop times for a multiple of the block length; ticks beyond the horizon have no length, their loops are lost."""
    if plan.slots:
        return loop_times
    lost = -loop_times.shape[0] % block_length(plan.lag)
    return jnp.concatenate([loop_times, jnp.full((lost, *loop_times.shape[1:]), jnp.inf, loop_times.dtype)])


def _where(condition: bool | Array, due: Command, held: Command) -> Command:
    return jax.tree.map(lambda new, old: jnp.where(condition, new, old), due, held)


def _per_robot(goal: Array, start: Array) -> Array:
    """Goals [N, 2, *1], of the rank of the start poses."""
    each = jnp.broadcast_to(goal, (start.shape[0], 2))
    return each.reshape(each.shape + (1,) * (start.ndim - 2))


def _batch_shape(start: Array, loop_times: Array, design: Design) -> tuple[int, ...]:
    leaves = (*(getattr(design, name) for name in CONTINUOUS), *design.others.values())
    return jnp.broadcast_shapes(start[:, 0].shape, loop_times.shape[1:], *(jnp.shape(leaf) for leaf in leaves))
