"""The work of the benchmark: one study of the paper's size, for qocjax and for the baselines."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from experiments.bench.baselines.work import DESIGN, Work
from qocjax import Design, Scenario, paper_network
from qocjax.batch.drawing import draw_seeds
from qocjax.scenario import num_ticks

__all__ = ["NETWORK", "SIZES", "Part", "Size", "Study", "drawn_designs", "make_study", "work_of"]

NETWORK = paper_network()
TAU = 0.01  # s

# On the grid every deadline is a multiple of tau, and a tick is one arc; off it a tick is two.
OFF_GRID_MS = {"on": 0, "off": 5}


@dataclass(frozen=True)
class Part:
    """What of a study is run, where all of it would take too long."""

    every: int = 1  # of so many deadlines, the first
    designs: int | None = None  # at each deadline; None for all


@dataclass(frozen=True)
class Size:
    """How much is run: every design with every seed at every deadline."""

    designs: int
    seeds: int
    deadlines_ms: tuple[int, ...]
    horizon: float  # s
    rounds: int  # calls after the first
    parts: dict[str, Part]  # of all but the fastest
    in_turn: bool = True  # one call at a time; without it times mean nothing


SIZES = {
    "smallest": Size(2, 2, (100, 300), 1.0, 1, {"medium": Part(1), "slow": Part(2), "slowest": Part(2, 1)}, False),
    "paper": Size(
        41, 32, tuple(range(100, 801, 20)), 30.0, 5,
        {"medium": Part(2), "slow": Part(9, 20), "slowest": Part(9, 4)},
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Study:
    """Arguments of `qocjax.evaluate`."""

    scenario: Scenario
    designs: Design  # [G], deadline by deadline
    seeds: range

    @property
    def robot_steps(self) -> int:
        """G S N P."""
        ticks = num_ticks(self.scenario.horizon, TAU)
        return np.size(self.designs.deadline) * len(self.seeds) * self.scenario.num_robots * ticks


def drawn_designs(count: int) -> dict[str, np.ndarray]:
    """Values within a fifth of the defaults, each [count]; the first are the same whatever the count."""
    spread = np.random.default_rng(0).uniform(0.8, 1.2, (count, len(DESIGN)))
    return {name: value * spread[:, k] for k, (name, value) in enumerate(DESIGN.items())}


def make_study(size: Size, grid: str, part: Part) -> Study:
    """The study, or a part of it.

    Args:
        size: How much of it there is.
        grid: `on` for deadlines that are multiples of tau, `off` for others.
        part: What of it is run.
    """
    designs = drawn_designs(part.designs or size.designs)
    deadlines = (np.array(size.deadlines_ms[:: part.every]) + OFF_GRID_MS[grid]) / 1000
    values = {name: np.tile(each, len(deadlines)) for name, each in designs.items()}
    deadline = np.repeat(deadlines, len(designs["kappa"]))
    return Study(Scenario(horizon=size.horizon), Design(**values, tau=TAU, deadline=deadline), range(size.seeds))


def work_of(study: Study) -> Work:
    """The same study as plain arrays: a lane for each design and seed, on the loop times and starts of `evaluate`."""
    scenario, designs = study.scenario, study.designs
    start = jnp.asarray(scenario.start, jnp.result_type(float))
    ticks = num_ticks(scenario.horizon, TAU)
    starts, times, _ = draw_seeds(start, scenario.start_jitter, NETWORK, np.array(study.seeds), 0, ticks, TAU)
    g, s = (a.ravel() for a in np.indices((np.size(designs.deadline), len(study.seeds))))
    lanes = {name: np.asarray(getattr(designs, name))[g] for name in (*DESIGN, "deadline")}
    return Work(
        **lanes,
        seed=s,
        loop_times=np.asarray(times),
        start=np.asarray(starts),
        tau=TAU,
        horizon=scenario.horizon,
        goal=tuple(np.asarray(scenario.goal).tolist()),
        weights=tuple(np.asarray(scenario.weights).tolist()),
        reference_kappa=float(np.asarray(scenario.nominal_kappa)),
        reference_v_max=float(np.asarray(scenario.nominal_v_max)),
    )
