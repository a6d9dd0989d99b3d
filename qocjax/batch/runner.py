"""Runs one batch: draws what its seeds share, and calls the compiled loop."""

from __future__ import annotations

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax._math import EXACT, MAX_HALF_ANGLE, POLYNOMIAL, AngleMath
from qocjax.batch.layout import Batch
from qocjax.batch.xla import CompileCache
from qocjax.closed_loop import Plan, run_closed_loop
from qocjax.network.interface import Network, loop_times
from qocjax.network.schedule import Rules
from qocjax.quality import initial_norm
from qocjax.reference import reference_origin
from qocjax.scenario import CONTINUOUS, Design, Scenario
from qocjax.simulate import check_start

__all__ = ["PER_ROBOT", "PER_RUN", "Runner", "jittered_start", "seed_keys"]

PER_ROBOT = ("auc", "path_length", "effort", "arrival_time")
PER_RUN = ("min_distance", "collided", "completed_share", "age_mean", "age_peak")

_programs = CompileCache()


def seed_keys(key: int, seeds: np.ndarray) -> tuple[Array, Array]:
    """Keys of the start jitter and of the loop times of each seed, [S] each; a seed's do not depend on the others."""
    root = jax.random.key(key)
    both = jax.vmap(lambda s: jax.random.split(jax.random.fold_in(root, s)))(jnp.asarray(seeds))
    return both[:, 0], both[:, 1]


def jittered_start(scenario: Scenario, keys: Array) -> Array:
    """Start poses of each seed, [S, N, 3]: position and heading perturbed by the scenario's jitter (model, section 1)."""
    return _jittered(jnp.asarray(scenario.start, jnp.result_type(float)), scenario.start_jitter, keys)


@partial(jax.jit, static_argnums=1)
def _jittered(start: Array, jitter: tuple[float, float], keys: Array) -> Array:
    spread = jnp.asarray([jitter[0], jitter[0], jitter[1]], start.dtype)
    noise = jax.vmap(lambda k: jax.random.normal(k, start.shape, start.dtype))(keys)
    return start[None] + noise * spread[None, None, :]


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
    ) -> None:
        self.grid, self.network, self.seeds, self.rules, self.dtype = grid, network, seeds, rules, dtype
        self.original = scenario
        self.scenario: Scenario = jax.tree.map(lambda a: np.asarray(a, dtype), scenario)
        self.jitter_keys, self.network_keys = seed_keys(key, seeds)
        half_turn = float(np.max(grid["omega_max"] * grid["tau"])) / 2
        polynomial = dtype == np.float32 and half_turn <= MAX_HALF_ANGLE
        self.math: AngleMath = POLYNOMIAL if polynomial else EXACT
        # The batches of one tau and one set of seeds come in a row: two sets are enough for all workers.
        self.draw = lru_cache(maxsize=2)(self._draw)

    def empty(self) -> dict[str, np.ndarray]:
        """Room for the results, [G, S, N] or [G, S]."""
        shape = (len(self.grid["tau"]), len(self.seeds))
        full = {name: np.empty((*shape, self.scenario.num_robots), self.dtype) for name in PER_ROBOT}
        return full | {name: np.empty(shape, bool if name == "collided" else self.dtype) for name in PER_RUN}

    def run(self, batch: Batch) -> dict[str, np.ndarray]:
        """Metrics of one batch, [N, designs, seeds] or [designs, seeds]."""
        group = batch.group
        start, times = self.draw(group.tau, group.ticks, tuple(batch.seeds.tolist()))
        values = {name: self.grid[name][batch.designs].astype(self.dtype)[None, :, None] for name in CONTINUOUS}
        timing = {"tau": np.asarray(group.tau, self.dtype), "deadline": np.asarray(group.deadline, self.dtype)}
        args = (self.scenario, Design(**values, **timing), start, times)
        plan = Plan(self.rules, self.math, group.slots, group.mid_tick)
        leaves, structure = jax.tree.flatten(args)
        key = (plan, structure, tuple((np.shape(leaf), np.result_type(leaf)) for leaf in leaves))
        program = _programs.get(key, lambda: jax.jit(_metrics, static_argnums=4).lower(*args, plan))
        return jax.tree.map(np.asarray, program(*args))

    def _draw(self, tau: float, ticks: int, chosen: tuple[int, ...]) -> tuple[Array, Array]:
        """Start poses [N, 3, 1, seeds] and loop times [P, N, 1, seeds] of the chosen seeds."""
        which = np.asarray(chosen)
        start = jittered_start(self.original, self.jitter_keys[which])
        times = loop_times(self.network, self.network_keys[which], ticks, self.scenario.num_robots, tau)
        check_start(self.scenario, np.moveaxis(np.asarray(start), 0, -1))
        return (
            jnp.moveaxis(start.astype(self.dtype), 0, -1)[:, :, None, :],
            jnp.moveaxis(times.astype(self.dtype), 0, -1)[:, :, None, :],
        )


def _metrics(scenario: Scenario, design: Design, start: Array, loop_times: Array, plan: Plan) -> dict[str, Array]:
    """Metrics of a batch; the function that is compiled."""
    tally, network, _ = run_closed_loop(scenario, design, start, loop_times, plan)
    goal = jnp.broadcast_to(jnp.asarray(scenario.goal), (start.shape[0], 2))[..., None, None]
    norm = initial_norm(scenario, start, goal, reference_origin(start, scenario.reference_per_robot))
    closest = jnp.sqrt(tally.closest)
    rows = tally.integral.shape[1:]
    arrived = tally.last_away < loop_times.shape[0]
    return {
        "auc": tally.integral / norm,
        "path_length": tally.path_length,
        "effort": tally.effort,
        "arrival_time": jnp.where(arrived, (tally.last_away + 1.0) * design.tau, jnp.inf),
        "min_distance": closest,
        "collided": closest < 2.0 * scenario.robot_radius,
        "completed_share": jnp.broadcast_to(jnp.mean(network.completed, axis=(0, 1), dtype=closest.dtype), rows),
        "age_mean": jnp.broadcast_to(jnp.mean(network.age, axis=(0, 1)), rows),
        "age_peak": jnp.broadcast_to(jnp.max(network.age, axis=(0, 1)), rows),
    }
