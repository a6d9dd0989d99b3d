"""One batch of the closed loop as a compiled program, in variants, to time by itself.

    python -m experiments.bench.one_batch '{"designs": 16, "seeds": 32, "ticks": 300}'

is a process that answers each line on standard input with one timed call, as those of entries.py do.
"""

from __future__ import annotations

import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import Any
from unittest import mock

__all__ = ["OneBatch", "Program"]

RUNS_PER_CALL = 4096  # of each thread, so that a call is long against handing out batches


@dataclass(frozen=True)
class OneBatch:
    """What is run, and how; the defaults of the second part are what `qocjax.evaluate` chooses on a CPU."""

    designs: int
    seeds: int
    ticks: int
    deadline: float = 0.2  # s

    whole_loop: bool = True  # needs to be asked for before JAX starts: read by `python -m` only
    vector_width: int | None = 512  # None for XLA's own choice
    level: int | None = 1  # None for XLA's own choice
    math: str = "polynomial"
    layout: str = "seeds last"  # or: designs last, nothing shared
    threads: int | None = None  # None for all cores

    @property
    def runs(self) -> int:
        """Designs times seeds."""
        return self.designs * self.seeds

    @property
    def robot_steps(self) -> int:
        """Of one call of the program, with two robots."""
        return self.runs * 2 * self.ticks


class Program:
    """The compiled program of a batch, its arguments on the device, and the seconds that compiling took."""

    def __init__(self, batch: OneBatch) -> None:
        import jax

        from qocjax import _xla as xla

        self.arguments, self.plan = _arguments(batch)
        options = {"xla_cpu_prefer_vector_width": batch.vector_width, "xla_backend_optimization_level": batch.level}
        xla._CPU_OPTIONS = {name: value for name, value in options.items() if value is not None}
        begin = time.perf_counter()
        self.lowered = jax.jit(_totals, static_argnums=4).lower(*self.arguments, self.plan)
        self.compiled = xla.compiled(self.lowered)
        self.compile_s = time.perf_counter() - begin
        self.arguments = jax.device_put(self.arguments)

    def call(self) -> Any:
        """Runs the batch and waits for it."""
        import jax

        return jax.block_until_ready(self.compiled(*self.arguments))

    def carried(self) -> list[Any]:
        """Shapes and types of what the scan over the ticks hands from one to the next.

        Seen by tracing once more with an ear on `lax.scan`: its parameters in a jaxpr differ between versions of JAX.
        """
        import jax

        heard: list[list[Any]] = []
        scan = jax.lax.scan

        def listening(body: Any, init: Any, *args: Any, **options: Any) -> Any:
            heard.append([jax.typeof(leaf) for leaf in jax.tree.leaves(init)])
            return scan(body, init, *args, **options)

        with mock.patch.object(jax.lax, "scan", listening):
            jax.eval_shape(lambda *arguments: _totals(*arguments, self.plan), *self.arguments)
        return max(heard, key=len)


def _arguments(batch: OneBatch) -> tuple[tuple, Any]:
    """Scenario, designs, start poses and loop times as the layout wants them, and the plan."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from experiments.bench.study import NETWORK, TAU, drawn_designs
    from qocjax import Design, Rules, Scenario
    from qocjax._math import EXACT, angle_math
    from qocjax.batch.drawing import draw_seeds
    from qocjax.closed_loop import Plan

    scenario = Scenario(horizon=batch.ticks * TAU)
    first = jnp.asarray(scenario.start, jnp.result_type(float))
    drawn = draw_seeds(first, scenario.start_jitter, NETWORK, np.arange(batch.seeds), 0, batch.ticks, TAU)
    start, times = (np.moveaxis(np.asarray(each, np.float32), 0, -1) for each in drawn[:2])
    values = {name: value.astype(np.float32) for name, value in drawn_designs(batch.designs).items()}
    if batch.layout == "seeds last":
        start, times = start[:, :, None], times[:, :, None]
        values = {name: value[None, :, None] for name, value in values.items()}
    elif batch.layout == "designs last":
        start, times = start[..., None], times[..., None]
        values = {name: value[None, None] for name, value in values.items()}
    else:
        start, times = np.tile(start, batch.designs), np.tile(times, batch.designs)
        values = {name: np.repeat(value, batch.seeds)[None] for name, value in values.items()}
    design = Design(**values, tau=np.float32(TAU), deadline=np.float32(batch.deadline))
    plan = Plan(
        Rules(),
        EXACT if batch.math == "exact" else angle_math(float(values["omega_max"].max()) * TAU / 2),
        slots=int(batch.deadline / TAU) + 2,
        mid_tick=abs(batch.deadline / TAU - round(batch.deadline / TAU)) > 1e-6,
    )
    scenario = jax.tree.map(lambda a: np.asarray(a, np.float32), scenario)
    return (scenario, design, start, times), plan


def _totals(scenario: Any, design: Any, start: Any, loop_times: Any, plan: Any) -> Any:
    """All that is summed up over a run; the function that is compiled."""
    from qocjax.closed_loop import run_closed_loop

    tally, network, *_ = run_closed_loop(scenario, design, start, loop_times, plan)
    return tally, network.age.mean(), network.completed.mean()


def _serve(batch: OneBatch) -> None:
    """Answers lines until standard input ends."""
    if batch.whole_loop:
        from qocjax._xla import request_whole_loop

        request_whole_loop()
    program = Program(batch)
    threads = batch.threads or len(os.sched_getaffinity(0))
    batches = threads * -(-RUNS_PER_CALL // batch.runs)
    with ThreadPoolExecutor(threads) as pool:
        for _ in sys.stdin:
            begin = time.perf_counter()
            list(pool.map(lambda _: program.call(), range(batches)))
            seconds = time.perf_counter() - begin
            answer = {"seconds": seconds, "robot_steps": batch.robot_steps * batches}
            print(json.dumps(answer | {"compile_s": program.compile_s}), flush=True)


if __name__ == "__main__":
    given = json.loads(sys.argv[1])
    _serve(OneBatch(**{item.name: given[item.name] for item in fields(OneBatch) if item.name in given}))
