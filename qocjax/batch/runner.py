"""Runs one batch: draws what its seeds share, and calls the compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax._kept import program as kept_program
from qocjax._math import EXACT, AngleMath, angle_math
from qocjax._once import Once
from qocjax._xla import compiled
from qocjax.batch.drawing import NOTHING, Chance, drawn
from qocjax.batch.layout import LANES, Batch, Group
from qocjax.closed_loop import Plan, run_closed_loop
from qocjax.controllers import Apf, Controller
from qocjax.network.contention import contended_times, draw_length, source_of
from qocjax.network.interface import Network, SharedNetwork, general_length
from qocjax.network.schedule import Rules
from qocjax.quality import initial_norm
from qocjax.reference import reference_origin
from qocjax.scenario import Design, Scenario
from qocjax.single import check_start

__all__ = ["Drawn", "Measure", "Runner", "metrics"]

# What is measured of a batch: (scenario, design, what its seeds drew, ticks within the horizon, plan) -> arrays
# [N, designs, seeds] or [designs, seeds]. Hashable, since programs are kept by it.
Measure = Callable[[Scenario, Design, "Drawn", Array, Plan], dict[str, Array]]


class Drawn(NamedTuple):
    """What the runs of a batch have in common."""

    start: Array  # [N, 3, 1, S] start poses
    loop_times: Array  # [P, N, 1, S] T_net (s)
    keys: Array  # [1, S, 2] words of a random key, for controllers that draw


_programs: Once[Callable[..., Any]] = Once()  # of all evaluations of this process, each for one device

# What seeds drew, of all evaluations: a search asks for the same seeds again and again. Only sets of up to 4 MiB.
_kept: Once[Drawn] = Once(capacity=16)
_WORTH_KEEPING = 1 << 22

# Loop times that are worked out at once where they depend on the deadline: about 128 MiB.
_AT_ONCE = 1 << 25


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
        self.start, self.key = np.asarray(scenario.start, jnp.result_type(float)), key
        # What many batches share is put on an accelerator once; a CPU reads it where it is.
        self.scenario: Scenario = jax.tree.map(lambda a: np.asarray(a, dtype), scenario)
        if jax.default_backend() != "cpu":
            self.scenario = jax.device_put(self.scenario)
        self.measure, self.in_blocks = measure, in_blocks
        # The batches of one tau and one set of seeds come in a row: a few sets are enough for all workers.
        self._chance: Once[Chance] = Once(capacity=4)
        self._contended: Once[np.ndarray] = Once(capacity=4)
        self._drawn: Once[Drawn] = Once(capacity=4)

    def math(self, period: float) -> AngleMath:
        """Functions of angles for arcs of up to a sampling period."""
        return angle_math(float(np.max(self.grid["omega_max"])) * period / 2) if self.dtype == np.float32 else EXACT

    def run(self, batch: Batch) -> dict[str, np.ndarray]:
        """What is measured of one batch, [N, designs, seeds] or [designs, seeds]."""
        group = batch.group
        drawn = self._drawn.get((*_set_of(batch), self._at(group)), lambda: self._checked(batch))
        timing = {"tau": np.asarray(group.tau, self.dtype), "deadline": np.asarray(group.deadline, self.dtype)}
        values = {name: each[batch.designs].astype(self.dtype)[None, :, None]
                  for name, each in self.grid.items() if name not in timing}  # fmt: skip
        args = (self.scenario, Design.checked(values | timing), drawn, np.int32(group.ticks))
        slots, lag = (0, group.lag) if self.in_blocks else (group.slots, 0)
        math = self.math(group.longest_period)
        plan = Plan(self.rules, math, slots, group.mid_tick, lag=lag, controller=self.controller)
        leaves, structure = jax.tree.flatten(args)
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        key = (self.measure, plan, structure, shapes, getattr(jax.config, "jax_default_device", None))
        program = _programs.get(key, lambda: kept_program(self.measure, args, (plan,), compiled))
        return jax.tree.map(np.asarray, program(*args))

    def _checked(self, batch: Batch) -> Drawn:
        """What the runs of a batch have in common, drawn now or before, once these robots may start there."""
        length, robots, lanes = batch.group.length, self.scenario.num_robots, len(batch.seeds)
        if isinstance(self.network, SharedNetwork) or length * robots * lanes * self.dtype.itemsize > _WORTH_KEEPING:
            drawn = self._draw(batch)
        else:
            device = getattr(jax.config, "jax_default_device", None)
            start = (self.start.tobytes(), self.start.shape, self.start.dtype, self.scenario.start_jitter)
            key = (*start, self.network, self.key, self.dtype, device, batch.group.tau, batch.group.ticks, length)
            drawn = _kept.get((*key, self.seeds[batch.seeds].tobytes()), lambda: self._draw(batch))
        poses = np.asarray(drawn.start)[:, :, 0]
        check_start(self.scenario, poses)
        self.controller.check_start(self.scenario, poses, self.seeds[batch.seeds])
        return drawn

    def _draw(self, batch: Batch) -> Drawn:
        """What chance gives to a batch, loop times for the ticks of its program."""
        group = batch.group
        chance = self._chance.get(_set_of(batch), lambda: self._draw_chance(batch))
        times = np.asarray(self._loop_times(batch, chance))[:, : group.ticks]
        if np.isnan(times).any() or (times < 0).any():
            raise ValueError("network: drew NaN or a negative loop time, expected seconds >= 0 (inf where lost)")
        poses = np.moveaxis(np.asarray(chance.start, self.dtype), 0, -1)
        loops = np.full((group.length, self.scenario.num_robots, 1, len(batch.seeds)), np.inf, self.dtype)
        loops[: group.ticks, :, 0] = np.moveaxis(times, 0, -1)
        return Drawn(*jax.device_put((poses[:, :, None, :], loops, np.asarray(chance.keys)[None])))

    def _draw_chance(self, batch: Batch) -> Chance:
        """What the seeds of a batch fix; drawn for as many at a time as most batches have, by one program."""
        seeds = self.seeds[batch.seeds]
        blocks = [self._draw_block(batch.group, seeds[k : k + LANES]) for k in range(0, seeds.size, LANES)]
        return blocks[0] if len(blocks) == 1 else jax.tree.map(lambda *each: np.concatenate(each), *blocks)

    def _draw_block(self, group: Group, seeds: np.ndarray) -> Chance:
        """What some seeds fix."""
        device = getattr(jax.config, "jax_default_device", None)
        length = group.length if group.general else general_length(group.ticks)
        given = getattr(self.network, "given", None)
        network = NOTHING if given else source_of(self.network)
        ticks, tau = draw_length(network, group.ticks, group.tau, length)
        args, static = (self.start, seeds, np.int32(self.key)), (self.scenario.start_jitter, network)
        key = (*static, *map(np.shape, args[:2]), self.start.dtype, ticks, tau, device)
        program = _programs.get(key, lambda: kept_program(drawn, args, (*static, ticks, tau), compiled))
        found = program(*args)
        robots = self.start.shape[0]
        return found._replace(network=given(seeds.tolist(), self.key, group.ticks, robots)) if given else found

    def _loop_times(self, batch: Batch, chance: Chance) -> Any:
        """Loop times [S, P, N] s, at the deadline of the batch where they depend on it."""
        network = self.network
        if not isinstance(network, SharedNetwork):
            return chance.network
        limits, place = self._limits(batch.group)
        found = self._contended.get(
            (*_set_of(batch), limits.tobytes()), lambda: self._contend(network, batch, chance, limits)
        )
        return found[place]

    def _contend(self, network: SharedNetwork, batch: Batch, chance: Chance, limits: np.ndarray) -> np.ndarray:
        """Loop times [D, S, P, N] s at some deadlines."""
        group = batch.group
        return np.asarray(contended_times(network, chance.network, group.ticks, group.tau, limits))

    def _limits(self, group: Group) -> tuple[np.ndarray, int]:
        """Deadlines whose loop times are worked out together with those of a group, and where its own is.

        All are of one length, so that one program does.
        """
        if not self._at(group):
            return np.zeros(1), 0
        every = np.unique(self.grid["deadline"][self.grid["tau"] == group.tau])
        size = min(every.size, max(1, _AT_ONCE // (group.length * self.scenario.num_robots * self.seeds.size)))
        first, place = divmod(int(np.searchsorted(every, group.deadline)), size)
        some = every[first * size : (first + 1) * size]
        return np.pad(some, (0, size - some.size), mode="edge"), place

    def _at(self, group: Group) -> tuple[float, ...]:
        """The deadline, where loop times depend on it."""
        return (group.deadline,) if getattr(self.network, "uses_deadline", False) else ()


def _set_of(batch: Batch) -> tuple[float, int, bytes]:
    """What is the same for all batches that share what chance decides."""
    return batch.group.tau, batch.group.length, batch.seeds.tobytes()


def metrics(scenario: Scenario, design: Design, drawn: Drawn, ticks: Array, plan: Plan) -> dict[str, Array]:
    """All metrics of a batch (model, section 5). Only the first `ticks` ticks lie within the horizon."""
    start, loop_times, keys = drawn
    tally, network, report, _ = run_closed_loop(scenario, design, start, loop_times, plan, keys, ticks)
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
