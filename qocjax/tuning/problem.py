"""What is tuned: points in free coordinates, each at a deadline of its own, scored on common random numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax.batch.evaluate import run_grid
from qocjax.batch.runner import Drawn, metrics
from qocjax.closed_loop import Plan
from qocjax.quality import qoc_slope
from qocjax.scenario import Design, Scenario
from qocjax.search.objective import Objective
from qocjax.statistics.scores import Scores, seed_scores
from qocjax.study.edges import at_bounds
from qocjax.tuning.bounds import Bounds

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Problem", "spread_starts"]

_MAX_RUNS = 512  # of a batch that carries tangents, as in `gradient`


@dataclass(frozen=True)
class Problem:
    """Maximise the mean QoC in the free coordinates of the tuned parameters, at every deadline at once."""

    objective: Objective
    baseline: Design  # numbers; what is not tuned stays at them
    bounds: Bounds
    deadlines: np.ndarray  # [G] s, of each point

    def designs(self, free: np.ndarray) -> Design:
        """Designs of points [G, K, d] (K variants of each) or [G, d], flattened in that order."""
        points = np.asarray(free, np.float64).reshape(len(self.deadlines), -1, len(self.bounds))
        values = self.bounds.values(points).reshape(-1, len(self.bounds))
        deadlines = np.repeat(self.deadlines, points.shape[1])
        return self.baseline.having(dict(zip(self.bounds.names, values.T, strict=True)) | {"deadline": deadlines})

    def scores(self, free: np.ndarray, seeds: Sequence[int]) -> np.ndarray:
        """QoC by seed of points [G, K, d] or [G, d]: [G, K, S] or [G, S]."""
        found = self.objective.scores(self.designs(free), seeds)
        return found.reshape(*np.shape(free)[:-1], len(seeds))

    def judged(self, free: np.ndarray, seeds: Sequence[int]) -> tuple[Scores, Scores]:
        """Scores [G, S] of points [G, d], and of the baseline at the same deadlines."""
        axis, place = np.unique(self.deadlines, return_inverse=True)
        own, untuned = self.designs(free), replace(self.baseline, deadline=axis)
        found = [self.objective.judged(self.objective.runs(designs, seeds)) for designs in (own, untuned)]
        return found[0], found[1][place]

    def at_bounds(self, deadline: float, values: np.ndarray) -> str:
        """At which ends of what is searched a point lies; empty for none."""
        design: dict[str, float] = {"deadline": deadline} | dict(zip(self.bounds.names, values, strict=True))
        ends = zip(self.bounds.low.tolist(), self.bounds.high.tolist(), strict=True)
        return at_bounds(design, dict(zip(self.bounds.names, ends, strict=True)), {"deadline": self.deadlines.tolist()})

    def pathwise(self, free: np.ndarray, seeds: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """QoC of each run and its derivative in the free coordinates, by differentiating the closed loop.

        A run that carries d tangents along counts as 1 + d simulations.

        Args:
            free: [G, d].
            seeds: S Monte Carlo seeds.

        Returns:
            [G, S] and [G, S, d]; what is not finite stays so.
        """
        setting, names = self.objective, self.bounds.names
        runs = run_grid(
            setting.scenario, self.designs(free), setting.network, seeds, _RobotSlopes(names),
            rules=setting.rules, key=setting.key, dtype=np.float32, max_runs=_MAX_RUNS, controller=setting.controller,
        )  # fmt: skip
        setting.simulations += runs.sizes["design"] * runs.sizes["seed"] * (1 + len(names))
        return self._chain(free, runs)

    def _chain(self, free: np.ndarray, runs: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
        """From AUC by robot to QoC by run, and from values to free coordinates."""
        scale = self.objective.scale
        auc = runs["auc"].values.astype(np.float64)  # [G, S, N]
        slopes = np.stack([runs[f"d_auc_{name}"].values.astype(np.float64) for name in self.bounds.names], axis=-1)
        by_run = (qoc_slope(auc, scale)[..., None] * slopes).mean(axis=2)
        return seed_scores(auc, scale), by_run * self.bounds.slopes(free)[:, None, :]


def spread_starts(count: int, bounds: Bounds, rng: np.random.Generator) -> np.ndarray:
    """Random points, evenly spread on the scale of each parameter, a twentieth off its bounds: free, [count, d]."""
    share = rng.uniform(0.05, 0.95, (count, len(bounds)))
    return np.log(share) - np.log1p(-share)


@dataclass(frozen=True)
class _RobotSlopes:
    """Measures the AUC of each robot in each run and its derivatives, in forward mode."""

    names: tuple[str, ...]

    def __call__(self, scenario: Scenario, design: Design, drawn: Drawn, ticks: Array, plan: Plan) -> dict[str, Array]:
        """The measure, [N, designs, seeds] each."""
        start = drawn.start
        shape = (1, jnp.shape(design.kappa)[1], start.shape[-1])
        values = {name: jnp.broadcast_to(design.values()[name], shape) for name in self.names}

        def auc(values: dict[str, Array]) -> Array:
            return metrics(scenario, design.having(values), drawn, ticks, plan)["auc"]

        basis = {
            name: jnp.zeros((len(self.names), *shape), start.dtype).at[k].set(1.0) for k, name in enumerate(self.names)
        }
        cost, slopes = jax.vmap(lambda tangent: jax.jvp(auc, (values,), (tangent,)), out_axes=(None, 0))(basis)
        return {"auc": cost} | {f"d_auc_{name}": slopes[k] for k, name in enumerate(self.names)}
