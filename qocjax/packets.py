"""Packets: commands that are plans (hold `buffer`; packetised predictive control).

The packet of the loop that begins at t_p carries the commands u_{p,0} .. u_{p,M-1}, one a sampling period from t_p + Δ
on. With s(t) the newest completed loop with t_s + Δ <= t, the robot drives

    u(t) = u_{s,k},   k = floor((t - t_s - Δ) / τ),   and stands where k >= M, and before the first packet.

So a packet's first command takes effect where a single command would; with every loop missed it plays its next one each
period, at the instant at which the missed command would have taken effect, and then stops. Plans begin from the pose
predicted at t_p + Δ: the sampled one, moved on through what was sent before, as if all of those loops complete,

    x̂_p = x_p ∘ g(u_{p-l-1,0}, r) ∘ g(u_{p-l,0}, τ) ∘ ... ∘ g(u_{p-1,0}, τ),   Δ = l τ + r,

with g the robot's motion under a command and u_{q,0} = 0 for q < 0. With actuation `instant` it is the sampled pose.

M = 1 is hold `zero` with prediction: the robots stand and drive at the same times, by commands for the predicted
instead of the sampled poses; where Δ = 0, or with `instant`, the two are one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.controllers.interface import Task
from qocjax.controllers.rolled import follow
from qocjax.robots import Command, Pose

__all__ = ["Replayed", "UnderWay", "following", "in_force", "none_under_way"]


def in_force(packet: Command) -> Command:
    """The command that a packet, each field [M, N, *B], stands at."""
    return jax.tree.map(lambda a: a[0], packet)


def following(fresh: Array, due: Command, held: Command) -> Command:
    """The packet in force one period on: the one that is due where its loop completed, else the rest of the one held.

    Args:
        fresh: [N, *B'] whether the loop completed.
        due: Each field [M, N, *B].
        held: Each field [M, N, *B].
    """
    rest = jax.tree.map(lambda a: jnp.concatenate([a[1:], jnp.zeros_like(a[:1])]), held)
    return jax.tree.map(lambda new, old: jnp.where(fresh[None], new, old), due, rest)


def none_under_way(task: Task, pose: Pose, lag: int) -> UnderWay | Replayed:
    """Nothing sent yet.

    Args:
        task: What does not change.
        pose: Start poses, each field [N, *B].
        lag: Whole sampling periods of the deadline; read where the loop has no buffer.
    """
    still = task.robot.still(pose)
    if task.robot.left_invariant and not task.robot.remembers:
        return UnderWay(_origin(still), still, still)
    room = task.slots or lag + 1
    return Replayed(jax.tree.map(lambda a: jnp.zeros((room, *a.shape), a.dtype), still), jnp.array(0, jnp.int32))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class UnderWay:
    """What was sent, for left-invariant robots that obey at once: one rigid motion, whatever the deadline.

    Motions are a group: as a command is sent its motion is put behind, and the oldest one's inverse in front. So a
    prediction costs the same at every deadline.
    """

    motion: Pose  # of the commands of the last l periods, from the origin
    oldest: Command  # u_{p-l-1,0}
    last: Command  # u_{p-1,0}

    def predicted(self, task: Task, pose: Pose, speed: Command | None) -> tuple[Pose, Command | None]:
        """Where the robots will be when the commands of this instant take effect, and at what speed."""
        begin, _ = follow(task, pose, None, self.oldest, task.rest)
        return _then(begin, self.motion), _unless_at_once(task, speed, self.last)

    def sent(self, task: Task, command: Command) -> UnderWay:
        """After a command is sent."""
        end = task.robot.move(self.motion, None, command, jnp.asarray(task.design.tau), task.math)[-1]
        return replace(self, motion=end.pose, last=end.speed)

    def due(self, task: Task, command: Command) -> UnderWay:
        """After the command of l periods ago, that of this one included, is due."""
        gone, _ = follow(task, _origin(command), None, command, jnp.asarray(task.design.tau))
        return replace(self, motion=_then(_back(gone), self.motion), oldest=command)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Replayed:
    """What was sent, for robots of any kind: driven through at each instant, command by command."""

    ring: Command  # u_{q,0} of the last ticks q, by tick; each field [room, N, *B]
    tick: Array  # p

    def predicted(self, task: Task, pose: Pose, speed: Command | None) -> tuple[Pose, Command | None]:
        """Where the robots will be when the commands of this instant take effect, and at what speed."""
        room = self.ring.nu.shape[0]
        # Where the loop has no buffer the number is known beforehand, so that reverse mode can go through.
        count = jnp.minimum(task.lag + 1, room) if task.slots else room

        def move(k: Array, at: tuple[Pose, Command | None]) -> tuple[Pose, Command | None]:
            place = (self.tick - count + k) % room
            command = jax.tree.map(lambda a: lax.dynamic_index_in_dim(a, place, 0, keepdims=False), self.ring)
            return follow(task, *at, command, jnp.where(k == 0, task.rest, task.design.tau))

        there, driven = lax.fori_loop(0, count, move, (pose, speed))
        return there, _unless_at_once(task, speed, driven)

    def sent(self, task: Task, command: Command) -> Replayed:
        """After a command is sent."""
        put = lambda ring, new: lax.dynamic_update_index_in_dim(ring, new, self.tick % len(ring), 0)  # noqa: E731
        return Replayed(jax.tree.map(put, self.ring, command), self.tick + 1)

    def due(self, task: Task, command: Command) -> Replayed:
        """After the command of l periods ago is due: it is in the ring."""
        return self


def _unless_at_once(task: Task, now: Command | None, then: Command | None) -> Command | None:
    """The speed that commands lead to until those of this instant take effect, or that of now where they do at once."""
    if now is None:
        return None
    at_once = task.lag + task.rest <= 0
    return jax.tree.map(lambda now, then: jnp.where(at_once, now, then), now, then)


def _origin(like: Command) -> Pose:
    zero = jnp.zeros_like(like.nu)
    return Pose(zero, zero, zero + 1.0, zero, zero)


def _back(motion: Pose) -> Pose:
    """The inverse of a rigid motion."""
    return Pose(
        x=-(motion.cos * motion.x + motion.sin * motion.y),
        y=motion.sin * motion.x - motion.cos * motion.y,
        cos=motion.cos,
        sin=-motion.sin,
        heading=-motion.heading,
    )


def _then(first: Pose, second: Pose) -> Pose:
    """One rigid motion after another, each as where it takes the origin; or a pose, moved."""
    return Pose(
        x=first.x + first.cos * second.x - first.sin * second.y,
        y=first.y + first.sin * second.x + first.cos * second.y,
        cos=first.cos * second.cos - first.sin * second.sin,
        sin=first.sin * second.cos + first.cos * second.sin,
        heading=first.heading + second.heading,
    )
