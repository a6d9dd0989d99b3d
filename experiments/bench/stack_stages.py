"""Where a cycle of the navigation stack spends its time: processor time of its stages, each compiled by itself.

    python experiments/bench/stack_stages.py [--samples 2000] [--map map.yaml]

128 cycles of the two robots of the hall, or of those on another map; microseconds per cycle, the best of several calls.
What a critic takes is the difference that it makes to the local controller when it is left out. Keeps
stack_stages.csv in experiments/bench/results.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import jax
import jax.numpy as jnp
import pandas as pd
from jax import Array, lax

from experiments.prediction import configured
from qocjax._xla import compiled, request_whole_loop
from qocjax.navigation import NavigationStack, read_map
from qocjax.navigation.cycle import Robot, View, _cost, _layers, _step, cycle
from qocjax.navigation.iteration import weights_of
from qocjax.navigation.noise import normal_pairs
from qocjax.navigation.path_critics import furthest_reached
from qocjax.navigation.planner import plan
from qocjax.study.replayed import replay

RESULT = Path(__file__).parent / "results" / "stack_stages.csv"
FIRST, LAST = 10, 74  # sampling instants whose cycles are timed: both robots drive
REPEATS = 7


def cycles(stack: NavigationStack) -> View:
    """What robots had before them, leaves [C, ...]."""
    config = configured("hall")
    scenario = replace(config.build_scenario(), horizon=4.0)
    few = replace(stack, mppi=replace(stack.mppi, batch_size=64))
    run = replay(scenario, config.baseline(), config.build_network(), 0, controller=few)
    return jax.tree.map(lambda a: a[FIRST:LAST].reshape(-1, *a.shape[2:]), run.view)


def microseconds(stage: Callable[..., Any], *cases: Any) -> float:
    """Per case, of a stage that goes through them one by one."""
    program = compiled(jax.jit(lambda *all_: lax.map(lambda case: stage(*case), all_)).lower(*cases))
    best = float("inf")
    for _ in range(REPEATS + 1):  # the first one is a warm-up
        begin = time.process_time()
        jax.block_until_ready(program(*cases))
        best = min(best, time.process_time() - begin)
    return 1e6 * best / len(jax.tree.leaves(cases)[0])


def stages(stack: NavigationStack, view: View) -> dict[str, float]:
    """Microseconds per cycle of each."""
    dtype, config, grid = view.begin.dtype, stack.mppi, stack.static_map.grid
    cost = lax.map(lambda each: _cost(stack, each.obstacles, dtype), view)
    drawn = normal_pairs(jax.random.key(0), config.time_steps, config.batch_size, dtype)
    ends = jnp.stack([each[0] for each in drawn])

    def robot(one: View) -> Robot:
        return Robot(one.words, one.state, one.path, one.has_path, one.begin, one.speed, one.obstacles, one.goal,
                     one.limits, one.values)  # fmt: skip

    def local(parts: NavigationStack) -> Callable[..., Any]:
        return lambda one, cells: _step(parts, one.words, one.state, one.begin, one.speed, cells, one.path, one.goal,
                                        one.limits)[:2]  # fmt: skip

    def scored(one: View) -> tuple[Array, ...]:
        weight = weights_of(ends[0] + one.begin[0], config.temperature)
        return tuple(each @ weight for each in drawn)

    def noise(one: View) -> tuple[Array, ...]:
        pairs = normal_pairs(jax.random.wrap_key_data(one.words), config.time_steps, config.batch_size, dtype)
        return tuple(each[0] for each in lax.optimization_barrier(pairs))

    def reached(one: View) -> Array:
        path = _Path(one.path[:51, 0], one.path[:51, 1])
        return furthest_reached(path, config.path_spacing, *ends, ends[0] ** 2)  # type: ignore[arg-type]

    whole = microseconds(local(stack), view, cost)
    found = {
        "cycle that does not plan": microseconds(lambda one: cycle(stack, robot(one), jnp.array(False))[:2], view),
        "costmap": microseconds(lambda one: _cost(stack, one.obstacles, dtype), view),
        "costmap, all layers of all cells": microseconds(
            lambda one: _layers(stack, one.obstacles, dtype).total().astype(dtype), view
        ),
        "global plan, where due": microseconds(
            lambda one, cells: plan(cells, one.begin[:2], one.goal, grid, stack.planner).points, view, cost
        ),
        "local controller": whole,
        "of it: noise": microseconds(noise, view),
        "of it: last path point reached": microseconds(reached, view),
        "of it: weights and averages": microseconds(scored, view),
    }  # fmt: skip
    for left_out in config.critics:
        rest = tuple(each for each in config.critics if each is not left_out)
        without = replace(stack, mppi=replace(config, critics=rest))
        found[f"of it: {type(left_out).__name__}"] = whole - microseconds(local(without), view, cost)
    return found


class _Path:
    """The points of a path."""

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y


def main() -> None:
    """Measures, prints and keeps the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=2000, help="K, rollouts of a cycle")
    parser.add_argument("--map", type=Path, help="a map.yaml in place of the hall's")
    options = parser.parse_args()
    request_whole_loop()
    stack = configured("hall").build_controller()
    assert isinstance(stack, NavigationStack)
    stack = replace(stack, mppi=replace(stack.mppi, batch_size=options.samples))
    if options.map:
        stack = replace(stack, static_map=read_map(options.map))
    table = pd.DataFrame(stages(stack, cycles(stack)).items(), columns=["stage", "us_per_cycle"])
    print(table.to_string(index=False, float_format="%.1f"))
    if not options.map:
        table.to_csv(RESULT, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
