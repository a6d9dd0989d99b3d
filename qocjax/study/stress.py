"""A network that becomes worse, and what is left of a design on it (model, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import xarray as xr
from jax import Array

from qocjax.network import Load, Network, Reliability, SharedNetwork, completes
from qocjax.network._fields import store_float
from qocjax.network.interface import Contended
from qocjax.scenario import Design
from qocjax.study.character import lost_share
from qocjax.study.margins import Bound, reach
from qocjax.study.objective import Objective
from qocjax.study.reliability import load_of, reliability_of
from qocjax.study.scores import Scores
from qocjax.study.statistics import estimate
from qocjax.study.statistics import share as share_of

__all__ = ["GROWTHS", "Stressed", "largest_growth", "of_runs", "stress_table"]

GROWTHS = (1.0, 1.05, 1.15, 1.3, 1.5, 2.0, 3.0)  # of all loop times, the deadline kept


@dataclass(frozen=True)
class Stressed:
    """A network that became worse: every loop takes longer, or is lost when a second copy of the network fails too.

    Losses of the copy come as they do in the network itself, in bursts where it has bursts: a lost share p becomes
    1 - (1 - p)², about 2 p. With `miss_deadline` a loop is also lost where its copy misses that deadline: so F becomes
    F² there.
    """

    network: Network
    delay_factor: float = 1.0
    double_losses: bool = False
    miss_deadline: float | None = None  # s

    def __post_init__(self) -> None:
        store_float(self, "delay_factor", above=0.0)
        if self.miss_deadline is not None:
            store_float(self, "miss_deadline", least=0.0)

    @property
    def name(self) -> str:
        """Name of the network and what happened to it."""
        doubled = ", losses doubled" if self._copied else ""
        return f"{self.network.name}, delay x {self.delay_factor:g}{doubled}"

    @property
    def uses_deadline(self) -> bool:
        """Whether the network's own loop times depend on the deadline."""
        return bool(getattr(self.network, "uses_deadline", False))

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> tuple[Any, Any]:
        """Draws from the network for one Monte Carlo seed, and from its copy where there is one."""
        own = self.network.draw(key, num_ticks, num_robots, tau)
        if not self._copied:
            return own, None
        return own, self.network.draw(jax.random.fold_in(key, 1), num_ticks, num_robots, tau)

    def contend(self, drawn: tuple[Any, Any], num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        """Loop times of all seeds at all deadlines; those that stay are the network's own times the factor."""
        own, copy = drawn
        found = self._loops(own, num_ticks, tau, deadline / self.delay_factor)
        times = found.loop_times
        if self._copied:
            other = self._loops(copy, num_ticks, tau, deadline / self.delay_factor).loop_times
            kept = jnp.isfinite(other) if self.miss_deadline is None else completes(other, self.miss_deadline)
            times = jnp.where(kept, times, jnp.inf)
        return found._replace(loop_times=times * self.delay_factor)

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Returns F(deadline) under a load."""
        share, error = self.network.reliability(np.asarray(deadline, float) / self.delay_factor, load)
        if not self._copied:
            return Reliability(share, error)
        kept, spread = self.network.reliability(np.inf if self.miss_deadline is None else self.miss_deadline, load)
        return Reliability(share * kept, np.hypot(error * kept, share * spread))

    @property
    def _copied(self) -> bool:
        return self.double_losses or self.miss_deadline is not None

    def _loops(self, drawn: Any, num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        if isinstance(self.network, SharedNetwork):
            return self.network.contend(drawn, num_ticks, tau, deadline)
        times = jnp.broadcast_to(drawn[None], (deadline.shape[0], *drawn.shape))
        return Contended(times, {}, jnp.full_like(times, jnp.inf), jnp.zeros_like(times))

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        own = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "network"}
        return {"kind": "Stressed", "name": self.name} | own | {"network": self.network.describe()}


def of_runs(runs: xr.Dataset, k: int, units: np.ndarray | None = None) -> dict[str, float]:
    """What else is said of the k-th design of some runs, with 95 % intervals; `units` as of `units_of`."""
    auc = runs["auc"].values[k].astype(float)
    cost = estimate(np.where(np.isfinite(auc), auc, np.nanmax(runs["auc"].values)).mean(axis=-1), units=units)
    collided = share_of(runs["collided"].values[k], units)
    return {
        "auc": cost.mean, "auc_low": cost.low, "auc_high": cost.high,
        "collision_share": collided.mean, "collision_low": collided.low, "collision_high": collided.high,
        "completed_share": float(runs["completed_share"].values[k].mean()),
        "age_peak_p99": float(np.quantile(runs["age_peak"].values[k], 0.99)),
    }  # fmt: skip


def stress_table(objective: Objective, design: Design, seeds: Sequence[int]) -> pd.DataFrame:
    """A design on worse networks, paired with itself on the network as it is, the first row.

    Args:
        objective: The setting.
        design: Numbers.
        seeds: [S] at least two.

    Returns:
        Per case: what, deadline (s), reliability with its standard error, qoc and change with both 95 % intervals
        (`_whole_` with the error of J_med in it), and what `of_runs` says.
    """
    network, deadline = objective.network, float(np.asarray(design.deadline))
    longer = replace(design, deadline=1.5 * deadline)
    cases: list[tuple[str, Network, Design]] = [
        ("as it is", network, design),
        ("as it is, deadline x 1.5", network, longer),
        ("delay x 1.5, deadline kept", slow := Stressed(network, delay_factor=1.5), design),
        ("delay x 1.5, deadline x 1.5", slow, longer),
    ]
    if lost_share(network, load_of(objective.scenario, float(np.asarray(design.tau)))) > 0:
        cases.append(("lost loops x 2", Stressed(network, double_losses=True), design))
    cases.append(("missed loops x 2", Stressed(network, miss_deadline=deadline), design))
    table: list[dict[str, Any]] = []
    base: Scores | None = None
    for what, worse, chosen in cases:
        runs, scores = _on(objective, worse, chosen, seeds)
        base = scores if base is None else base
        share, error = reliability_of(worse, objective.scenario, chosen.deadline, chosen.tau)
        table.append(
            {"what": what, "deadline": float(np.asarray(chosen.deadline)), "reliability": float(share),
             "reliability_se": float(error)}
            | scores.mean().columns("qoc") | (scores - base).mean().columns("change")
            | of_runs(runs, 0, scores.units)
        )  # fmt: skip
    return pd.DataFrame(table)


def largest_growth(objective: Objective, design: Design, seeds: Sequence[int], share: float) -> Bound:
    """By what factor all loop times may grow, the deadline kept, until QoC falls by more than a share.

    Args:
        objective: The setting.
        design: Numbers.
        seeds: [S] at least two, common to all factors.
        share: Of the QoC on the network as it is.
    """
    network = objective.network
    slower: list[Network] = [network if growth == 1.0 else Stressed(network, growth) for growth in GROWTHS]
    scores = np.stack([_on(objective, worse, design, seeds)[1].values for worse in slower])
    return reach(GROWTHS, scores - (1.0 - share) * scores[0], 0.0, objective.units(seeds))


def _on(objective: Objective, network: Network, design: Design, seeds: Sequence[int]) -> tuple[xr.Dataset, Scores]:
    """Runs and scores [S] of one design on another network; the simulations count for the objective."""
    setting = replace(objective, network=network, simulations=0)
    runs = setting.runs(design, seeds)
    objective.simulations += setting.simulations
    return runs, setting.judged(runs)[0]
