"""Model predictive path integral control (model, section 9).

Williams, Drews, Goldfain, Rehg and Theodorou, "Information-theoretic model predictive control: theory and applications
to autonomous driving", IEEE T-RO 34(6), 2018; in the form of Nav2's `nav2_mppi_controller` (optimizer.cpp of its
branches lyrical and main): K sequences of commands are drawn about that of the cycle before, rolled out for H steps,
scored by critics, and averaged with weights exp(-cost / temperature). The first command of a sequence is that of now,
the one that is sent comes a cycle later.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from qocjax._math import angle_math
from qocjax.navigation.critics import COLLISION, Scene
from qocjax.navigation.feasible import feasible, speed_now
from qocjax.navigation.iteration import Rollouts, iterate
from qocjax.navigation.local_path import MapCosts, local_path
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.smoothing import HISTORY, shifted, smoothed
from qocjax.robots import Command, Pose, Robot, Unicycle

__all__ = [
    "Limits",
    "Rollouts",
    "State",
    "initial_state",
    "predict",
    "predict_driven",
    "step",
    "step_each",
]


_UNICYCLE = Unicycle()


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class State:
    """What one cycle hands to the next."""

    vx: Array  # [H] sequence to draw about, which begins with the command sent last (m/s)
    wz: Array  # [H] rad/s
    past_vx: Array  # [4] what the filter made of the commands sent last, the latest one last (m/s)
    past_wz: Array  # [4] rad/s
    vy: Array | None = None  # [H] m/s, of Omni
    past_vy: Array | None = None  # [4] m/s

    @property
    def sequence(self) -> Command:
        """To draw about, each field [H]."""
        return Command(self.vx, self.wz, self.vy)

    @property
    def past(self) -> Command:
        """What the filter made of the commands sent last, each field [4]."""
        return Command(self.past_vx, self.past_wz, self.past_vy)


class Limits(NamedTuple):
    """What may differ between runs of one compiled program."""

    vx_max: ArrayLike  # m/s
    wz_max: ArrayLike  # rad/s, at most that of the configuration
    period: ArrayLike  # of the cycle (s)

    @classmethod
    def of(cls, config: MppiConfig) -> Limits:
        """Those of a configuration."""
        return cls(config.vx_max, config.wz_max, 1.0 / config.controller_frequency)


def initial_state(config: MppiConfig, dtype: jnp.dtype | None = None) -> State:
    """A robot at rest, with no command sent."""
    still = jnp.zeros(config.time_steps, dtype)
    past = still[:1].repeat(HISTORY)
    return State(still, still, past, past, *((still, past) if config.holonomic else ()))


def predict(pose: Array, commands: Command, durations: Array) -> Array:
    """Pose of a unicycle after commands that are under way, each in force for its duration (model, section 2).

    Rollouts that start from it, in place of the pose that was sampled, allow for the delay of the loop.

    Args:
        pose: [3, *B] x, y, heading (m, m, rad).
        commands: Each field [n, *B], in the order in which they are in force.
        durations: [n] (s); 0 for none.

    Returns:
        The poses, [3, *B].
    """
    return predict_driven(_UNICYCLE, pose, jax.tree.map(lambda each: each[0], commands), commands, durations)[0]


def predict_driven(
    robot: Robot, pose: Array, speed: Command, commands: Command, durations: Array
) -> tuple[Array, Command]:
    """`predict` for any robot.

    Args:
        robot: What moves.
        pose: [3, *B] x, y, heading (m, m, rad).
        speed: At which it drives, each field [*B].
        commands: Each field [n, *B], in the order in which they are in force.
        durations: [n] (s); 0 for none.

    Returns:
        The poses, [3, *B], and the speeds.
    """

    def move(state: tuple[Pose, Command], row: tuple[Command, Array]) -> tuple[tuple[Pose, Command], None]:
        (at, driven), (command, duration) = state, row
        last = robot.move(at, driven, command, duration, angle_math(jnp.inf))[-1]
        return (last.pose, last.speed), None

    begin = Pose(pose[0], pose[1], jnp.cos(pose[2]), jnp.sin(pose[2]), pose[2])
    (end, driven), _ = lax.scan(move, (begin, speed), (commands, durations))
    return jnp.stack([end.x, end.y, end.heading]), driven


def step(
    config: MppiConfig,
    state: State,
    pose: Array,
    costmap: MapCosts,
    path: Array,
    goal: Array,
    key: Array,
    record: bool = False,
    limits: Limits | None = None,
    speed: Command | None = None,
) -> tuple[Command, State, Rollouts]:
    """One cycle of the controller, for one robot; `jax.vmap` takes it over robots and simulations.

    Args:
        config: Parameters; static under jit.
        state: From the cycle before, or `initial_state`.
        pose: [3] where the rollouts begin: as sampled, or from `predict` (m, m, rad).
        costmap: The map.
        path: [P, 2] global path to the goal (m), P >= 2; a shorter one is filled up with its last point.
        goal: [3] (m, m, rad).
        key: Random key.
        record: Whether the points of the rollouts are returned.
        limits: Caps and period in place of the configuration's.
        speed: Of the robot, each field []: where the rollouts begin. None to take it to be that sent last.

    Returns:
        The command (each field []), the next state, and what was looked at.

    Raises:
        ValueError: The shape of an argument is another; the message names it.
    """
    _check_shapes(config, state, pose, path, goal)
    limits = limits or Limits.of(config)
    scene = _scene(config, limits, pose, costmap, path, goal)
    sent = jax.tree.map(lambda each: each[0], state.sequence)
    now = speed_now(config, sent, speed, limits.period)
    mean = jax.tree.map(lambda each, first: each.at[0].set(first), state.sequence, now)
    for iteration in range(config.iteration_count):
        mean, rollouts = iterate(config, scene, pose, mean, jax.random.fold_in(key, iteration), record)
        smooth = jax.tree.map(lambda each, past: smoothed(each, past, config.sgf_order), mean, state.past)
        mean = feasible(config, now, smooth, scene)
    ahead = limits.period / config.model_dt
    after, smooth = jax.tree.map(lambda each: shifted(each, ahead), (mean, smooth))
    if config.stop_if_blocked:
        after, smooth = jax.tree.map(lambda each: jnp.where(rollouts.blocked, 0.0, each), (after, smooth))
    past = jax.tree.map(lambda old, new: jnp.append(old[1:], new[0]), state.past, smooth)
    command = jax.tree.map(lambda each: each[0], after)
    return command, State(after.nu, after.omega, past.nu, past.omega, after.nu_y, past.nu_y), rollouts


def step_each(
    config: MppiConfig, states: State, poses: Array, costmaps: MapCosts, paths: Array, goals: Array, keys: Array
) -> tuple[Command, State, Rollouts]:
    """`step` for R robots one after the other; all arguments, and all results, with a leading axis R.

    On CPUs it takes half the time of `jax.vmap`, since the rollouts of one robot stay in cache; on an accelerator
    `jax.vmap` is the one to take.
    """
    return lax.map(lambda robot: step(config, *robot), (states, poses, costmaps, paths, goals, keys))


def _check_shapes(config: MppiConfig, state: State, pose: Array, path: Array, goal: Array) -> None:
    expected = (("pose", pose, (3,)), ("goal", goal, (3,)), ("state.vx", state.vx, (config.time_steps,)))
    for name, value, shape in expected:
        if jnp.shape(value) != shape:
            raise ValueError(f"{name}: got shape {jnp.shape(value)}, expected {shape}")
    if jnp.ndim(path) != 2 or jnp.shape(path)[1] != 2 or len(path) < 2:
        raise ValueError(f"path: got shape {jnp.shape(path)}, expected (P, 2) with P at least 2")


def _scene(config: MppiConfig, limits: Limits, pose: Array, costmap: MapCosts, path: Array, goal: Array) -> Scene:
    ahead = local_path(path, pose[0], pose[1], config.prune_distance, config.path_spacing)
    to_goal = jnp.hypot(pose[0] - goal[0], pose[1] - goal[1])
    clear = costmap.at(ahead.x, ahead.y) < COLLISION
    vx_min = jnp.maximum(config.vx_min, -jnp.asarray(limits.vx_max))  # no faster backwards than ahead
    vy_max = jnp.minimum(config.vy_max, jnp.asarray(limits.vx_max))  # nor faster to a side
    vx_max, vx_min, wz_max, vy_max = (
        jnp.asarray(each, pose.dtype) for each in (limits.vx_max, vx_min, limits.wz_max, vy_max)
    )
    radius = config.min_turning_r if config.motion_model == "Ackermann" else None
    return Scene(
        goal,
        to_goal,
        ahead,
        clear,
        costmap,
        config.path_spacing,
        config.model_dt,
        vx_max,
        vx_min,
        wz_max,
        vy_max,
        radius,
    )
