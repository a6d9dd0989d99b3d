"""What came out of a run: its loops, its poses, its quality of control, its percentiles."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from experiments.dds_testbed.crossing import ReceivedBy
from experiments.dds_testbed.link import EDGE, ROBOT, SIDES
from experiments.dds_testbed.plan import Plan
from qocjax import QocScale, Scenario, simulate
from qocjax.controllers import Controller
from qocjax.quality import Side, Tally, Yardstick, initial_norm
from qocjax.reference import reference_left, reference_origin, reference_way
from qocjax.robots import Command, pose_from

__all__ = ["auc_of", "ideal_scale", "loop_table", "loop_times", "messages", "pose_table", "received", "replayed"]


def loop_table(plan: Plan, start: int) -> pd.DataFrame:
    """One row per loop and robot of the run itself: four stamps and the time applied (s from the start), and delays.

    Stamps of the edge are on the edge's clock, which on one machine is the robots'. A lost loop has an infinite
    `loop_time`, and no stamp of what did not happen.
    """
    robot, edge = np.load(Path(plan.folder) / "robot.npz"), np.load(Path(plan.folder) / "edge.npy")
    first = plan.padding[0]
    sent, received = ((stamps[first : first + plan.num_ticks] - start) * 1e-9 for stamps in robot["stamps"])
    received = np.where(robot["stamps"][1, first : first + plan.num_ticks] > 0, received, np.nan)
    at_edge = np.full((2, plan.num_ticks, plan.num_robots), np.nan)
    of_run = edge[(edge[:, 1] >= 0) & (edge[:, 1] < plan.num_ticks) & (edge[:, 3] > 0)]
    at_edge[:, of_run[:, 1], of_run[:, 0]] = (of_run[:, 2:].T - start) * 1e-9
    shape = (plan.num_robots, plan.num_ticks)
    table = pd.DataFrame(
        {
            "robot": np.repeat(np.arange(shape[0]), shape[1]), "sequence": np.tile(np.arange(shape[1]), shape[0]),
            "uplink_send": sent.T.ravel(), "edge_receive": at_edge[0].T.ravel(), "edge_send": at_edge[1].T.ravel(),
            "downlink_receive": received.T.ravel(),
        }
    )  # fmt: skip
    table["uplink"] = table["edge_receive"] - table["uplink_send"]
    table["compute"] = table["edge_send"] - table["edge_receive"]
    table["downlink"] = table["downlink_receive"] - table["edge_send"]
    table["loop_time"] = (table["downlink_receive"] - table["uplink_send"]).fillna(np.inf)
    table["lost"] = np.isinf(table["loop_time"])
    return table


def received(plan: Plan) -> list[ReceivedBy]:
    """What each side has got, robots first."""
    return [ReceivedBy.read(Path(plan.folder) / f"received_{side}.npz") for side in SIDES]


def messages(plan: Plan, by_side: list[ReceivedBy]) -> dict[str, dict[str, int]]:
    """What has become of the messages of the run in each direction, told from their sequence numbers."""
    edge, ticks = np.load(Path(plan.folder) / "edge.npy"), range(plan.num_ticks)
    answers = {(robot, sequence) for robot, sequence, _, sent in edge.tolist() if sent > 0 and sequence in ticks}
    sent = {"uplink": plan.num_ticks * plan.num_robots, "downlink": len(answers)}
    found = {}
    for name, side in (("uplink", EDGE), ("downlink", ROBOT)):
        got: set[tuple[int, int]] = set()
        newest, repeated, reordered = [-(10**9)] * plan.num_robots, 0, 0
        for robot, sequence, _ in by_side[side].rows.tolist():
            if sequence in ticks:
                repeated += (robot, sequence) in got
                reordered += sequence < newest[robot]
                newest[robot] = max(newest[robot], sequence)
                got.add((robot, sequence))
        found[name] = {"sent": sent[name], "received": len(got), "lost": sent[name] - len(got), "repeated": repeated,
                       "reordered": reordered}  # fmt: skip
    return found


def pose_table(plan: Plan) -> pd.DataFrame:
    """Pose and command at the begin of each piece of constant command, and at the end; one row per robot."""
    pieces = np.load(Path(plan.folder) / "robot.npz")
    time = np.append(pieces["time"] * 1e-9, plan.horizon)
    pose, speeds = np.append(pieces["pose"], pieces["last"][None], axis=0), pieces["speeds"]
    speeds = np.append(speeds, speeds[-1:], axis=0)
    columns = {"time": np.repeat(time, plan.num_robots), "robot": np.tile(np.arange(plan.num_robots), len(time))}
    columns |= {name: pose[..., k].ravel() for k, name in enumerate(("x", "y", "heading"))}
    columns |= {name: speeds[:, k].ravel() for k, name in enumerate(("nu", "omega"))}
    return pd.DataFrame(columns)


def auc_of(scenario: Scenario, plan: Plan, pieces: Mapping[str, np.ndarray]) -> np.ndarray:
    """AUC of each robot from the motion as it was (`Robots.record`), [N] s (model, section 5)."""
    instants = np.append(pieces["time"] * 1e-9, plan.horizon)
    poses = np.concatenate([pieces["pose"], pieces["last"][None]])
    start, goal = jnp.asarray(scenario.start), jnp.broadcast_to(jnp.asarray(scenario.goal), (plan.num_robots, 2))
    left = reference_left(jnp.asarray(instants), start, goal, scenario, plan.as_design())
    yardstick = Yardstick(*reference_way(start, goal, scenario.reference_per_robot), scenario.weights)
    integral = _integral(yardstick, jnp.asarray(poses), jnp.asarray(pieces["speeds"]), jnp.asarray(instants), left)
    origin = reference_origin(start, scenario.reference_per_robot)
    return np.asarray(integral / initial_norm(scenario, start, goal, origin))


@jax.jit
def _integral(
    yardstick: Yardstick, poses: jax.Array, speeds: jax.Array, instants: jax.Array, left: jax.Array
) -> jax.Array:
    """∫ |delta|²_W dt of each robot over pieces of constant command, [N] m² s."""
    durations = jnp.pad(jnp.diff(instants), 1)  # nothing moves before the first piece and after the last
    drawn = durations[None] / 6 * jnp.pad(jnp.diff(left, axis=0), ((1, 1), (0, 0))).T
    speeds = jnp.pad(speeds, ((1, 1), (0, 0), (0, 0)))

    def over(tally: Tally, k: jax.Array) -> tuple[Tally, None]:
        sides = [Side(durations[p], Command(speeds[p, 0], speeds[p, 1]), drawn[:, p]) for p in (k, k + 1)]
        return tally.at_kink(yardstick, pose_from(poses[k]), *sides, left[k]), None

    tally, _ = jax.lax.scan(over, Tally.zero(pose_from(poses[0])), jnp.arange(len(instants)))
    return tally.integral


def loop_times(plan: Plan, loops: pd.DataFrame) -> np.ndarray:
    """T_net of a table of loops as a matrix, [P, N] s."""
    return loops["loop_time"].to_numpy().reshape(plan.num_robots, plan.num_ticks).T


def replayed(scenario: Scenario, plan: Plan, times: np.ndarray, controller: Controller) -> np.ndarray:
    """AUC that the simulator gives for the measured loop times [P, N], [N] s."""
    return np.asarray(simulate(scenario, plan.as_design(), times, **plan.rules, controller=controller).auc)


def ideal_scale(scenario: Scenario, plan: Plan, controller: Controller) -> QocScale:
    """Scale of a run on its own: QoC is 0.5 for a loop without delay or loss; robots that never move have J_max."""
    design, at_once = plan.as_design(), np.zeros((plan.num_ticks, plan.num_robots))
    ideal, stuck = (
        float(np.mean(simulate(scenario, design, times, "instant", controller=controller).auc))
        for times in (at_once, at_once + np.inf)
    )
    return QocScale(ideal, stuck)
