"""A run as the bag that a robot would have recorded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from experiments.dds_testbed.crossing import ReceivedBy
from experiments.dds_testbed.plan import Plan
from qocjax.ros import messages
from qocjax.ros.bag import BEGIN, Message, from_start, save

__all__ = ["record"]

_BEGIN = round(BEGIN * 1e9)


def record(path: Path, plan: Plan, received: ReceivedBy, start: int) -> Path:
    """Writes `/robot0/odom`, `/robot0/amcl_pose` and `/tf` at every sampling instant, and commands.

    As in Nav2's chain `/robot0/cmd_vel_nav` is what crossed the network, when it came, and `/robot0/cmd_vel` what the
    deadline gate let through, when it took effect. Both have the stamp of the state that they answer, so their ages can
    be told; what came before the run is left out.

    Args:
        path: Folder of the bag.
        plan: Of the run.
        received: What the robots received.
        start: First sampling instant (ns).

    Raises:
        ValueError: rosbags is not installed, or something other than a bag lies there.
    """
    return save(path, _messages(plan, received, start), plan.reliable, plan.depth)


def _messages(plan: Plan, received: ReceivedBy, start: int) -> Iterator[Message]:
    poses, speeds, sent = _sampled(plan, start)
    names = [f"robot{robot}" for robot in range(plan.num_robots)]
    frames = [("map", f"{name}/odom", poses[0, robot]) for robot, name in enumerate(names)]
    yield Message(_BEGIN, "/tf_static", messages.transforms(_BEGIN, frames))
    goals = np.broadcast_to(plan.goal, (plan.num_robots, 2))
    for robot, name in enumerate(names):
        yield Message(_BEGIN, f"/{name}/goal_pose", messages.pose(_BEGIN, "map", (*goals[robot], 0.0)))
        yield from _motion(name, poses[:, robot], speeds[:, robot], _BEGIN + sent[:, robot], plan.tau)
    for (robot, sequence, stamp), speed in zip(received.rows.tolist(), received.speeds, strict=True):
        if 0 <= sequence < plan.num_ticks:
            source, base = _BEGIN + sequence * plan.tau, f"{names[robot]}/base_footprint"
            yield Message(_BEGIN + stamp - start, f"/{names[robot]}/cmd_vel_nav", messages.twist(source, base, speed))
    yield from _let_through(plan, names)


def _let_through(plan: Plan, names: list[str]) -> Iterator[Message]:
    with np.load(Path(plan.folder) / "robot.npz") as file:
        changes = file["changes"]
    for robot, source, time, *speeds in changes.tolist():
        name = names[int(robot)]
        command = messages.twist(_BEGIN + int(source), f"{name}/base_footprint", speeds)
        yield Message(_BEGIN + int(time), f"/{name}/cmd_vel", command)


def _motion(name: str, poses: np.ndarray, speeds: np.ndarray, sent: np.ndarray, tau: int) -> Iterator[Message]:
    """Odometry, localisation and transform of a robot at its samples."""
    frame, base, odom = f"{name}/odom", f"{name}/base_footprint", from_start(poses)
    for k, time in enumerate(sent.tolist()):
        stamp = _BEGIN + k * tau
        yield Message(time, "/tf", messages.transforms(stamp, [(frame, base, odom[k])]))
        yield Message(time, f"/{name}/odom", messages.odometry(stamp, frame, base, odom[k], speeds[k]))
        yield Message(time, f"/{name}/amcl_pose", messages.pose_with_covariance(stamp, "map", poses[k]))


def _sampled(plan: Plan, start: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses [P + 1, N, 3], speeds [P + 1, N, 2] and times (ns from the start) [P + 1, N] of the samples and the end."""
    with np.load(Path(plan.folder) / "robot.npz") as pieces:
        at = np.searchsorted(pieces["time"], np.arange(plan.num_ticks) * plan.tau)  # each begins a piece
        poses = np.concatenate([pieces["pose"][at], pieces["last"][None]])
        speeds = pieces["speeds"][np.append(at, -1)].transpose(0, 2, 1)
        first = plan.padding[0]
        sent = pieces["stamps"][0, first : first + plan.num_ticks] - start
    return poses, speeds, np.concatenate([sent, np.full((1, plan.num_robots), round(plan.horizon * 1e9))])
