"""Runs one batch: draws what its seeds share, and calls the compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax._math import EXACT, AngleMath, angle_math
from qocjax.batch.layout import Batch, general_length
from qocjax.batch.once import Once
from qocjax.batch.xla import compiled
from qocjax.closed_loop import Plan, run_closed_loop
from qocjax.controllers import Apf, Controller
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.quality import initial_norm
from qocjax.reference import reference_origin
from qocjax.scenario import CONTINUOUS, Design, Scenario
from qocjax.simulate import check_start

__all__ = ["Drawn", "Measure", "Runner", "draw_seeds", "metrics"]

# What is measured of a batch: (scenario, design, what its seeds drew, ticks within the horizon, plan) -> arrays
# [N, designs, seeds] or [designs, seeds]. Hashable, since programs are kept by it.
Measure = Callable[[Scenario, Design, "Drawn", Array, Plan], dict[str, Array]]

_programs: Once[jax.stages.Compiled] = Once()  # of all evaluations of this process, each for one device


class Drawn(NamedTuple):
    """What Monte Carlo seeds fix."""

    start: Array  # start poses
    loop_times: Array  # T_net (s)
    keys: Array  # words of a random key, for controllers that draw


@partial(jax.jit, static_argnames=("jitter", "network", "num_ticks", "tau"))
def draw_seeds(
    start: Array,
    jitter: tuple[float, float],
    network: Network,
    seeds: Array,
    key: int | Array,
    num_ticks: int,
    tau: float,
) -> Drawn:
    """What Monte Carlo seeds fix; a seed's draws do not depend on which others are drawn with it.

    Args:
        start: [N, 3] nominal start poses.
        jitter: Standard deviation of position (m) and heading (rad) (model, section 1).
        network: Where loop times come from.
        seeds: [S] whole numbers.
        key: Root of all random numbers.
        num_ticks: P.
        tau: Sampling period (s).

    Returns:
        [S, N, 3] start poses and [S, P, N] loop times, in JAX's default float type, and [S, 2] words of keys.
    """
    spread = jnp.asarray([jitter[0], jitter[0], jitter[1]], start.dtype)
    root = jax.random.key(key)

    def draw(seed: Array) -> Drawn:
        of_seed = jax.random.fold_in(root, seed)
        of_start, of_network = jax.random.split(of_seed)
        noise = jax.random.normal(of_start, start.shape, start.dtype)
        times = network.draw(of_network, num_ticks, start.shape[0], tau)
        return Drawn(start + noise * spread[None, :], times, jax.random.key_data(jax.random.fold_in(of_seed, 2)))

    return jax.vmap(draw)(seeds)


class Runner:
    """Runs the batches of one evaluation; holds what they share."""

    def __init__(
        self,
        scenario: Scenario,
        grid: dict[str, np.ndarray],
        network: Network,
        seeds: np.ndarray,
        rules: Rules,
        key: int,
        dtype: np.dtype,
        measure: Measure,
        in_blocks: bool = False,
        controller: Controller | None = None,
    ) -> None:
        """Casts everything to `dtype`; `in_blocks` is how reverse mode wants the loop."""
        self.controller = controller or Apf()
        self.grid, self.network, self.seeds, self.rules, self.dtype = grid, network, seeds, rules, dtype
        self.start, self.key = jnp.asarray(scenario.start, jnp.result_type(float)), key
        # What many batches share is put on the device once.
        self.scenario: Scenario = jax.device_put(jax.tree.map(lambda a: np.asarray(a, dtype), scenario))
        self.measure, self.in_blocks = measure, in_blocks
        # The batches of one tau and one set of seeds come in a row: a few sets are enough for all workers.
        self._drawn: Once[Drawn] = Once(capacity=4)

    def math(self, period: float) -> AngleMath:
        """Functions of angles for arcs of up to a sampling period."""
        return angle_math(float(np.max(self.grid["omega_max"])) * period / 2) if self.dtype == np.float32 else EXACT

    def run(self, batch: Batch) -> dict[str, np.ndarray]:
        """What is measured of one batch, [N, designs, seeds] or [designs, seeds]."""
        group = batch.group
        drawn = self._drawn.get((group.tau, group.length, batch.seeds.tobytes()), lambda: self._draw(batch))
        values = {name: self.grid[name][batch.designs].astype(self.dtype)[None, :, None] for name in CONTINUOUS}
        timing = {"tau": np.asarray(group.tau, self.dtype), "deadline": np.asarray(group.deadline, self.dtype)}
        args = (self.scenario, Design(**values, **timing), drawn, np.int32(group.ticks))
        slots, lag = (0, group.lag) if self.in_blocks else (group.slots, 0)
        math = self.math(group.longest_period)
        plan = Plan(self.rules, math, slots, group.mid_tick, lag=lag, controller=self.controller)
        leaves, structure = jax.tree.flatten(args)
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        key = (self.measure, plan, structure, shapes, getattr(jax.config, "jax_default_device", None))
        program = _programs.get(key, lambda: compiled(jax.jit(self.measure, static_argnums=4).lower(*args, plan)))
        return jax.tree.map(np.asarray, program(*args))

    def _draw(self, batch: Batch) -> Drawn:
        """Start poses [N, 3, 1, seeds], loop times [ticks of the program, N, 1, seeds] and keys [1, seeds, 2]."""
        group = batch.group
        ticks, tau = group.ticks, group.tau
        stable = getattr(self.network, "prefix_stable", False)
        if stable and getattr(jax.config, "jax_threefry_partitionable", True):
            ticks, tau = general_length(ticks), 1.0  # one program for many sampling periods
        args = (self.start, self.scenario.start_jitter, self.network, self.seeds[batch.seeds], np.int32(self.key))
        shapes = (*map(np.shape, args[::3]), self.start.dtype)
        key = (self.network, *shapes, args[1], ticks, tau, getattr(jax.config, "jax_default_device", None))
        program = _programs.get(key, lambda: compiled(draw_seeds.lower(*args, ticks, tau)))
        start, times, keys = program(self.start, self.seeds[batch.seeds], np.int32(self.key))
        if np.isnan(times).any() or (np.asarray(times) < 0).any():
            raise ValueError("network: drew NaN or a negative loop time, expected seconds >= 0 (inf where lost)")
        poses = np.moveaxis(np.asarray(start, self.dtype), 0, -1)
        check_start(self.scenario, poses)
        self.controller.check_start(self.scenario, poses, self.seeds[batch.seeds])
        loops = np.full((group.length, self.scenario.num_robots, 1, len(batch.seeds)), np.inf, self.dtype)
        loops[: group.ticks, :, 0] = np.moveaxis(np.asarray(times)[:, : group.ticks], 0, -1)
        return Drawn(*jax.device_put((poses[:, :, None, :], loops, np.asarray(keys)[None])))


def metrics(scenario: Scenario, design: Design, drawn: Drawn, ticks: Array, plan: Plan) -> dict[str, Array]:
    """All metrics of a batch (model, section 5). Only the first `ticks` ticks lie within the horizon."""
    start, loop_times, keys = drawn
    tally, network, report, _ = run_closed_loop(scenario, design, start, loop_times, plan, keys)
    goal = jnp.broadcast_to(jnp.asarray(scenario.goal), (start.shape[0], 2))[..., None, None]
    norm = initial_norm(scenario, start, goal, reference_origin(start, scenario.reference_per_robot))
    closest = jnp.sqrt(tally.closest)
    rows = tally.integral.shape[1:]
    arrival = jnp.minimum((tally.last_away + 1.0) * design.tau, scenario.horizon)
    inside = (jnp.arange(network.age.shape[0]) < ticks).astype(closest.dtype)[:, None, None, None]
    loops = ticks.astype(closest.dtype) * start.shape[0]
    return {
        "auc": tally.integral / norm,
        "path_length": tally.path_length,
        "effort": tally.effort,
        "arrival_time": jnp.where(tally.last_away < ticks, arrival, jnp.inf),
        "min_distance": closest,
        "collided": closest < 2.0 * scenario.robot_radius,
        "completed_share": jnp.broadcast_to(jnp.sum(network.completed * inside, axis=(0, 1)) / loops, rows),
        "age_mean": jnp.broadcast_to(jnp.sum(network.age * inside, axis=(0, 1)) / loops, rows),
        "age_peak": jnp.broadcast_to(jnp.max(network.age * inside, axis=(0, 1)), rows),
        **report,
    }
