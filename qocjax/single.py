"""One run from given loop times, with its trajectory: `simulate`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax._card import card
from qocjax._kept import called
from qocjax._math import EXACT
from qocjax.closed_loop import Plan, run_closed_loop
from qocjax.controllers import Apf, Controller
from qocjax.controllers.held import held, holding
from qocjax.network.schedule import Rules, split_deadline
from qocjax.quality import initial_norm
from qocjax.reference import reference_origin
from qocjax.scenario import Design, Scenario, check_times, num_ticks
from qocjax.tunables import check_others

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Run", "check_start", "simulate"]

_USUAL_SLOTS = 128  # commands under way, enough for deadlines of a second and more at the model's tau


@jax.tree_util.register_dataclass
@dataclass(frozen=True, repr=False)
class Run:
    """One simulated run and its metrics."""

    time: Array  # [P+1] s
    pose: Array  # [P+1, N, 3] m, m, rad; headings continuous
    command: Array  # [P, N, 2] nu m/s, omega rad/s; in force at t_p, after what takes effect at t_p. [P, N, 3] of
    # holonomic robots, with nu_y m/s to the left
    speed: Array  # the same, as driven at t_p: the command where the robot obeys it at once
    age: Array  # [P, N] s, as the controller at t_p sees it
    auc: Array  # [N] s, J_i
    min_distance: Array  # m, smallest distance between robots at the sampling instants; inf for one robot
    collided: Array  # bool, whether that is below two robot radii
    path_length: Array  # [N] m, forwards and backwards
    effort: Array  # [N] ∫ nu² + omega² dt, with nu_y² of holonomic robots
    arrival_time: Array  # [N] s, from then on within 2 d_safe of the goal; inf if never
    completed_share: Array  # share of the loops that complete
    age_mean: Array  # s, over ticks and robots
    age_peak: Array  # s
    reference: Array  # [P+1, 2] m, or [P+1, N, 2] with a reference per robot
    goal: Array  # [2] or [N, 2] m
    d_safe: Array  # m
    deadline: Array  # s
    robot_radius: Array  # m
    report: dict[str, Array]  # the controller's own numbers, each [N]
    view: Any  # what the controller records of each instant; leaves [P, ...]

    def __repr__(self) -> str:
        """What it came to, in a line."""
        return f"Run({', '.join(f'{name} {value}' for name, value in self._facts().items())})"

    def _repr_html_(self) -> str:
        """What it came to, and each robot's metrics, for notebooks."""
        import pandas as pd  # takes long, and few look

        by_robot = {"J_i (s)": self.auc, "path (m)": self.path_length, "arrives (s)": self.arrival_time}
        table = pd.DataFrame({name: np.asarray(value) for name, value in by_robot.items()}).rename_axis("robot")
        return card("Run", self._facts(), table.reset_index())

    def _facts(self) -> dict[str, str]:
        if isinstance(self.auc, jax.core.Tracer) or np.ndim(self.auc) != 1:
            return {"arrays of shape": str(np.shape(self.auc))}
        instants, robots = np.shape(self.pose)[:2]
        return {
            "robots": f"{robots}",
            "time": f"{float(np.asarray(self.time)[-1]):g} s, {instants - 1} ticks",
            "Δ": f"{float(self.deadline) * 1e3:g} ms",
            "loops completed": f"{float(self.completed_share):.1%}",
            "AUC": f"{float(np.mean(self.auc)):.4g} s",
            "smallest distance": f"{float(self.min_distance):.3g} m" + (", collided" if self.collided else ""),
        }

    def to_pandas(self) -> pd.DataFrame:
        """One row per instant and robot: time, robot, x, y, heading, nu, omega, age (NaN at the last instant).

        Of holonomic robots with nu_y, after omega.
        """
        import pandas as pd  # takes long, and most runs are never a table

        instants, robots = np.shape(self.pose)[:2]
        pad = ((0, 1), (0, 0))
        columns = {name: np.asarray(self.pose)[..., k] for k, name in enumerate(("x", "y", "heading"))}
        columns |= {
            name: np.pad(np.asarray(self.command)[..., k], pad, constant_values=np.nan)
            for k, name in enumerate(("nu", "omega", "nu_y")[: np.shape(self.command)[-1]])
        }
        columns["age"] = np.pad(np.asarray(self.age), pad, constant_values=np.nan)
        index = {"time": np.repeat(np.asarray(self.time), robots), "robot": np.tile(np.arange(robots), instants)}
        return pd.DataFrame(index | {name: values.ravel() for name, values in columns.items()})

    def to_bag(self, path: str | Path, static_map: Any = None, stack: Any = None) -> Path:
        """Writes the run as a rosbag2 (MCAP) with ROS's names; see `qocjax.ros.bag.write_bag`."""
        from qocjax.ros.bag import write_bag  # files come after simulations

        return write_bag(path, self, static_map, stack)


def simulate(
    scenario: Scenario,
    design: Design,
    loop_times: ArrayLike,
    actuation: str = "deadline",
    hold: str = "hold",
    *,
    hold_timeout: float = 0.5,
    hold_decay: float = 0.5,
    plan_length: int | None = None,
    controller: Controller | None = None,
    key: Array | None = None,
) -> Run:
    """Simulates one run from given loop times.

    Works under `jax.jit`, `jax.vmap` and `jax.grad`, and is differentiable in the design's continuous values. (The
    derivative in the deadline is that between the multiples of tau; which loops complete is piecewise constant.)
    Runs of other designs, deadlines included, take the compiled program of the first; another number of ticks or
    robots, choice of the scenario or mode compiles again.

    Args:
        scenario: Start poses (used as they are, without jitter), goal, horizon, yardstick.
        design: One design; every value a number.
        loop_times: [P, N] T_net of the loop that starts at t_p (s), inf where lost. P covers the horizon:
            ceil(horizon / tau).
        actuation: `deadline`, `arrival` or `instant` (model, section 4).
        hold: `hold`, `zero`, `timeout`, `decay` (model, section 4) or `buffer` (`qocjax.packets`).
        hold_timeout: For `timeout` (s).
        hold_decay: For `decay` (s).
        plan_length: For `buffer`: M, commands of a packet.
        controller: What computes the commands, by default the surrogate law.
        key: Random key, for a controller that draws; `jax.random.key(0)` by default.

    Returns:
        Trajectory and metrics.

    Raises:
        ValueError: A start on the reference, loop times of the wrong shape, negative or NaN, or an unknown mode.
    """
    rules = Rules(actuation, hold, hold_timeout, hold_decay, plan_length)
    for argument, value, kind in (("scenario", scenario, Scenario), ("design", design, Design)):
        if not isinstance(value, kind):
            raise TypeError(f"{argument}: got {type(value).__name__}, expected a {kind.__name__}")
    for name, value in design.values().items():
        if np.ndim(value) != 0:
            raise ValueError(f"{name}: got shape {np.shape(value)}, expected one number")
    times = _checked_loop_times(scenario, design, loop_times)
    check_start(scenario, scenario.start)
    controller = controller or Apf()
    check_others(controller.tunables, design.others)
    controller.check(scenario, design, rules)
    mid_tick, slots = _timing(design, times.shape[0], rules)
    plan = Plan(rules, EXACT, slots, mid_tick, record=True, controller=controller)
    design = jax.tree.map(lambda each: _checks.array_of(each, times.dtype), design)  # 0 and 0.1 on one program
    words = jax.random.key_data(jax.random.key(0) if key is None else key)
    return called(_simulate, (scenario, design, times, words, held(controller)), (plan,))


def check_start(scenario: Scenario, start: ArrayLike) -> None:
    """Checks that no robot starts where the normaliser is zero.

    Args:
        scenario: Goal, reference and normaliser.
        start: [N, 3] start poses, or [N, 3, S] of S seeds.

    Raises:
        ValueError: One does; the message names the robot and the way out.
    """
    if not (_checks.is_concrete(start) and _checks.is_concrete(scenario.goal)):
        return
    begin = np.asarray(start, np.float64).reshape(scenario.num_robots, 3, -1)
    x, y = begin[:, 0], begin[:, 1]
    goal = np.broadcast_to(np.asarray(scenario.goal, np.float64), (scenario.num_robots, 2))[..., None]
    if scenario.normaliser == "initial_disagreement":
        from_x, from_y = (x, y) if scenario.reference_per_robot else (x.mean(axis=0), y.mean(axis=0))
        way_out = "expected it off the reference, or the normaliser 'goal_distance'"
    else:
        from_x, from_y = goal[:, 0], goal[:, 1]
        way_out = "expected it away from its goal"
    distance = np.hypot(x - from_x, y - from_y).min(axis=1)
    for robot in np.flatnonzero(distance <= 1e-9 * (1.0 + np.abs(begin).max())):
        raise ValueError(f"start: robot {robot} starts at disagreement 0 ({scenario.normaliser}), {way_out}")


def _checked_loop_times(scenario: Scenario, design: Design, loop_times: ArrayLike) -> Array:
    if _checks.is_concrete(loop_times):
        try:
            values = np.asarray(loop_times)
        except ValueError:
            raise ValueError("loop_times: got rows of different lengths, expected [P, N] seconds") from None
        if values.dtype.kind not in "iuf":
            raise TypeError(f"loop_times: got values of type {values.dtype}, expected seconds (inf where lost)")
        if np.isnan(values).any() or (values < 0).any():
            raise ValueError("loop_times: got NaN or a negative time, expected seconds >= 0 (inf where lost)")
    shape = np.shape(loop_times)
    if _checks.is_concrete(design.tau):
        check_times(scenario, design.tau)
        wanted = (num_ticks(scenario.horizon, float(np.asarray(design.tau))), scenario.num_robots)
        if shape != wanted:
            raise ValueError(f"loop_times: got shape {shape}, expected {wanted}: (horizon / tau, robots)")
    elif len(shape) != 2 or shape[1] != scenario.num_robots:
        raise ValueError(f"loop_times: got shape {shape}, expected (P, {scenario.num_robots})")
    return _checks.array_of(loop_times, jnp.result_type(float))


def _timing(design: Design, ticks: int, rules: Rules) -> tuple[bool | None, int]:
    """Whether commands take effect between sampling instants, where the rules tell, and room for those under way.

    Both are the same for many deadlines, which so share one program; a larger buffer costs next to nothing.
    """
    if rules.actuation == "instant":
        return False, 1
    mid_tick = None if rules.actuation == "deadline" else False
    if not (_checks.is_concrete(design.tau) and _checks.is_concrete(design.deadline)):
        return mid_tick, ticks + 2
    with jax.ensure_compile_time_eval():  # numbers also where the caller traces something else
        lag, _ = split_deadline(float(np.asarray(design.deadline)), float(np.asarray(design.tau)))
    room = max(_USUAL_SLOTS, 1 << (min(int(lag), ticks) + 1).bit_length())
    return mid_tick, min(room, ticks + 2)


def _simulate(scenario: Scenario, design: Design, loop_times: Array, words: Array, arrays: Any, plan: Plan) -> Run:
    plan = replace(plan, controller=holding(plan.controller, arrays))
    start = jnp.asarray(scenario.start, loop_times.dtype)
    tally, network, report, recorded = run_closed_loop(scenario, design, start, loop_times, plan, words)
    assert recorded is not None  # the plan records; for the type checker
    goal = jnp.broadcast_to(jnp.asarray(scenario.goal), (start.shape[0], 2))
    norm = initial_norm(scenario, start, goal, reference_origin(start, scenario.reference_per_robot))
    time = jnp.minimum(jnp.arange(loop_times.shape[0] + 1) * jnp.asarray(design.tau), scenario.horizon)
    arrived = tally.last_away < loop_times.shape[0]
    reference = jnp.stack(recorded.reference, axis=-1)
    apart = tally.closest > 0.0  # the gradient of a square root at zero is infinite
    closest = jnp.where(apart, jnp.sqrt(jnp.where(apart, tally.closest, 1.0)), 0.0)
    return Run(
        time=time,
        pose=jnp.stack([recorded.pose.x, recorded.pose.y, recorded.pose.heading], axis=-1),
        command=jnp.stack(jax.tree.leaves(recorded.command), axis=-1),
        speed=jnp.stack(jax.tree.leaves(recorded.speed), axis=-1),
        age=network.age,
        auc=tally.integral / norm,
        min_distance=closest,
        collided=closest < 2.0 * jnp.asarray(scenario.robot_radius),
        path_length=tally.path_length,
        effort=tally.effort,
        arrival_time=jnp.where(arrived, jnp.minimum((tally.last_away + 1.0) * design.tau, scenario.horizon), jnp.inf),
        completed_share=jnp.mean(network.completed, dtype=loop_times.dtype),
        age_mean=jnp.mean(network.age),
        age_peak=jnp.max(network.age),
        reference=reference if scenario.reference_per_robot else reference[:, 0],
        goal=jnp.asarray(scenario.goal),
        d_safe=jnp.asarray(design.d_safe),
        deadline=jnp.asarray(design.deadline),
        robot_radius=jnp.asarray(scenario.robot_radius),
        report=report,
        view=recorded.view,
    )
