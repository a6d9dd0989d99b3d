"""The closed loop of the model: one readable tick and one scan over the ticks (model, sections 2 to 5).

Every array ends in the same batch dimensions `*B`: none for one run, designs and seeds for a batch. The tick is written
once for both; how a batch is laid out is the business of `qocjax.batch`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import AngleMath
from qocjax.controllers import Apf, Controller, PlanMaker, Sight, Task, plan_of
from qocjax.network.schedule import Rules, Schedule, schedule, split_deadline
from qocjax.packets import Replayed, UnderWay, following, in_force, none_under_way
from qocjax.pipeline import Loop, block_length, in_blocks, through_buffer
from qocjax.quality import Side, Tally, Yardstick
from qocjax.reference import reference_path, reference_way
from qocjax.robots import Command, Pose, pose_from
from qocjax.scenario import Design, Scenario
from qocjax.timeline import Row, Stretch, cut, timeline
from qocjax.tunables import CONTINUOUS

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
    side: Side | None  # the motion that ends at t_p, None where the row and the command in force tell
    tally: Tally
    memory: Any  # the controller's
    under_way: UnderWay | Replayed | None  # what was sent, where a plan is to begin from the predicted pose


def run_closed_loop(
    scenario: Scenario,
    design: Design,
    start: Array,
    loop_times: Array,
    plan: Plan,
    keys: Array | None = None,
    ticks: Array | None = None,
) -> Outcome:
    """Simulates a batch of runs.

    Args:
        scenario: Goal, reference, weights, horizon; its own start poses are not read.
        design: Values broadcastable to [N, *B]; tau and deadline are scalars.
        start: [N, 3, *B] start poses, broadcastable to the batch.
        loop_times: [P, N, *B'] T_net (s), broadcastable to the batch.
        plan: What the loop is specialised for.
        keys: [*B, 2] words of a random key for each run, for controllers that draw.
        ticks: Of the loop times, how many lie within the horizon, where a program serves others too; read where there
            is a buffer and nothing is recorded.
    """
    loop_times = _whole_blocks(loop_times, plan)
    tau, deadline = jnp.asarray(design.tau), jnp.asarray(design.deadline)
    lag, rest = split_deadline(deadline, tau)
    mid_tick = rest > 0 if plan.mid_tick is None else plan.mid_tick
    network = schedule(loop_times, deadline, tau, plan.rules, mid_tick)

    num_ticks, goal = loop_times.shape[0], _per_robot(jnp.asarray(scenario.goal), start)
    last = None if plan.record or plan.slots == 0 else ticks
    rows, end = timeline(start, goal, network, scenario, design, None if mid_tick is False else rest, last)
    pose = jax.tree.map(lambda a: jnp.broadcast_to(a, _batch_shape(start, loop_times, design)), pose_from(start))
    still = scenario.robot.still(pose)
    task = Task((goal[:, 0], goal[:, 1]), design, plan.math, num_ticks, lag, rest, plan.slots, scenario.robot)
    memory = plan.controller.begin(task, pose, keys)
    packet, under_way = still, None
    if plan.rules.plan_length is not None:
        packet = jax.tree.map(lambda a: jnp.zeros((plan.rules.plan_length, *a.shape), a.dtype), still)
        if plan.rules.actuation == "deadline" and not isinstance(plan.controller, PlanMaker):
            under_way = none_under_way(task, pose, plan.lag)
    yardstick = Yardstick(*reference_way(start, goal, scenario.reference_per_robot), scenario.weights)
    tick = _Tick(scenario, task, yardstick, mid_tick, plan)
    state = _State(pose, packet, tick.first_side(still, end), Tally.zero(pose), memory, under_way)
    loop = Loop(tick.sample, tick.act, packet)
    if plan.slots == 0:
        state, recorded = in_blocks(loop, state, rows, plan.lag), None
    else:
        state, recorded = through_buffer(loop, state, rows, network.source, lag, plan.rules, plan.slots, last)
    tally = tick.at_end(state, end)
    report = plan.controller.report(state.memory)
    if recorded is None:
        return Outcome(tally, network, report, None)
    poses = jax.tree.map(lambda each, last: jnp.concatenate([each, last[None]]), recorded[0], state.pose)
    instants = jnp.minimum(jnp.arange(num_ticks + 1) * tau, scenario.horizon)
    path = reference_path(instants, start, goal, scenario, design)
    return Outcome(tally, network, report, Recorded(poses, recorded[1], recorded[2], path, recorded[3]))


@dataclass(frozen=True)
class _Tick:
    """One sampling period in two halves: sample and compute; let a command take effect and move."""

    scenario: Scenario
    task: Task
    yardstick: Yardstick
    mid_tick: bool | Array
    plan: Plan

    def first_side(self, still: Command, end: Row) -> Side | None:
        """What ends at the beginning: nothing, of the shapes of what will; None where that is not kept."""
        if self.scenario.robot.obeyed(still) is None:
            return Side(jnp.zeros_like(still.nu), still, jnp.zeros_like(still.nu))
        return Side(jnp.zeros_like(end.duration_before), still) if self.plan.controller.sees_speed else None

    def sample(self, state: _State, row: Row) -> tuple[_State, Command, Any]:
        """Reads the poses at t_p and computes the new command."""
        tally = state.tally.at_instant(row.tick, state.pose, self.task.goal, self.task.design)
        sight = Sight(row.tick, state.pose, row.network.age, self._speed(state))
        if (length := self.plan.rules.plan_length) is None:
            memory, command, view = self.plan.controller.command(self.task, state.memory, sight)
            return replace(state, tally=tally, memory=memory), command, view
        under_way = state.under_way
        if under_way is not None:
            sight = sight._replace(begin=under_way.predicted(self.task, state.pose, self._speed(state)))
        memory, packet, view = plan_of(self.plan.controller, self.task, state.memory, sight, length)
        if under_way is not None:
            under_way = under_way.sent(self.task, in_force(packet))
        return replace(state, tally=tally, memory=memory, under_way=under_way), packet, view

    def act(self, state: _State, row: Row, due: Command) -> tuple[_State, Any]:
        """The due command takes effect if its loop completed; the robots move, in two pieces where that is between.

        That is at t_p + rest, where the deadline is no multiple of tau.
        """
        net = row.network
        if state.under_way is not None:
            state = replace(state, under_way=state.under_way.due(self.task, in_force(due)))
        at_once, *later = row.stretches
        applied = self._choose(net.fresh, due, state.applied, jnp.logical_not(self.mid_tick) if later else True)
        first = self._driven(applied, net.gain_start)
        moved, side = self._move(replace(state, applied=applied), self._before(state, row), first, at_once)
        for stretch in later:
            # Computed once: all that the second motion gives would else have the first in it.
            halfway = replace(moved, pose=lax.optimization_barrier(moved.pose))
            applied = self._choose(net.fresh, due, applied, self.mid_tick)
            second = self._driven(applied, net.gain_mid)
            moved, side = self._move(replace(halfway, applied=applied), side, second, stretch)
        if state.side is not None:
            moved = replace(
                moved, side=jax.tree.map(lambda new, old: jnp.broadcast_to(new, old.shape), side, state.side)
            )
        if not self.plan.record:
            return moved, None
        return moved, (state.pose, first, self._speed(state) if self.scenario.robot.remembers else first)

    def at_end(self, state: _State, end: Row) -> Tally:
        """The totals, with what is read at the end of the horizon."""
        tally = state.tally.at_instant(end.tick, state.pose, self.task.goal, self.task.design)
        before, (nothing,) = self._before(state, end), end.stretches
        after = jax.tree.map(jnp.zeros_like, before)
        return tally.at_kink(
            self.yardstick, state.pose, before, after, nothing.left, nothing.bend if before.drawn is None else None
        )

    def _before(self, state: _State, row: Row) -> Side:
        """The motion that ends at t_p."""
        if state.side is not None:
            return state.side
        speed = self.scenario.robot.obeyed(self._driven(state.applied, row.gain_before))
        assert speed is not None  # else there is a side; for the type checker
        return Side(row.duration_before, speed)

    def _speed(self, state: _State) -> Command | None:
        """At which robots drive as t_p is reached: the last command if obeyed at once; None where nothing reads it."""
        if state.side is None or not (self.scenario.robot.remembers or self.plan.controller.sees_speed):
            return None
        return state.side.speed

    def _choose(self, fresh: Array, due: Command, held: Command, now: bool | Array) -> Command:
        """What is in force after an instant at which commands take effect, if this is one."""
        if self.plan.rules.plan_length is None:
            return _where(fresh if now is True else fresh & now, due, held)
        return _where(now, following(fresh, due, held), held)

    def _driven(self, applied: Command, gain: Array | None) -> Command:
        """The command that the robots follow."""
        return (applied if self.plan.rules.plan_length is None else in_force(applied)).scaled(gain)

    def _move(self, state: _State, before: Side, command: Command, stretch: Stretch) -> tuple[_State, Side]:
        """Moves under a constant command and takes each piece of the motion into the totals; says how it ends."""
        pieces = self.scenario.robot.move(state.pose, before.speed, command, stretch.duration, self.plan.math)
        one = self.scenario.robot.obeyed(command) is not None
        whole = [stretch] if one else cut(stretch, [each.duration for each in pieces])
        for piece, part in zip(pieces, whole, strict=True):
            drawn = None if one else part.drawn
            begin, end = (Side(part.duration, speed, drawn) for speed in (piece.begin, piece.speed))
            tally = state.tally.at_kink(self.yardstick, state.pose, before, begin, part.left, part.bend)
            state, before = replace(state, pose=piece.pose, tally=tally.over_piece(piece)), end
        return state, before


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
