"""Delay and reliability set apart: runs where every loop takes the same time and completes with the same chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
import xarray as xr

from qocjax import _checks
from qocjax.advice.reaching import NONE_ABOVE, Bound, bound_of, last_reached, reach
from qocjax.advice.target import Target, collision_excess
from qocjax.network import Constant, IndependentLoss, Leg, LoopNetwork
from qocjax.scenario import Design
from qocjax.search.objective import Objective
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.estimates import Estimate, standard_error
from qocjax.statistics.scores import Scores

__all__ = ["Plane", "delay_reliability_plane", "largest_delay", "smallest_reliability"]


@dataclass(frozen=True)
class Plane:
    """What becomes of gains where every loop takes the same time, which is the deadline, and completes as likely."""

    delay: np.ndarray  # [D] s, ascending
    reliability: np.ndarray  # [F] ascending
    scores: np.ndarray  # [F, D, S] QoC by seed; seeds are common to all cells
    merits: np.ndarray  # [F, D, S] of the target that is asked for, the larger the better
    collided: np.ndarray  # [F, D, S] which runs collided
    robots: int

    @property
    def qoc(self) -> np.ndarray:
        """Mean over seeds, [F, D]."""
        return self.scores.mean(axis=-1)

    @cached_property
    def close(self) -> list[Estimate]:
        """The share of runs with a collision of each cell, the delay running fastest."""
        return [collision_share(hits, self.robots) for hits in self.collided.reshape(-1, self.collided.shape[-1])]

    def excess(self, limit: float) -> np.ndarray:
        """By how much the share of runs with a collision passes a limit, by its upper end, [F, D]."""
        return collision_excess(self.close, limit).reshape(self.collided.shape[:-1])

    def to_table(self) -> pd.DataFrame:
        """One row per cell: delay (s), reliability, qoc, its standard error, collision share with its interval."""
        reliability, delay = np.meshgrid(self.reliability, self.delay, indexing="ij")
        cells = {"delay": delay, "reliability": reliability, "qoc": self.qoc, "qoc_se": standard_error(self.scores)}
        table = pd.DataFrame({name: values.ravel() for name, values in cells.items()})
        for end, name in (("mean", "share"), ("low", "low"), ("high", "high")):
            table[f"collision_{name}"] = [getattr(each, end) for each in self.close]
        return table


def delay_reliability_plane(
    objective: Objective,
    design: Design,
    delays: Sequence[float],
    reliabilities: Sequence[float],
    seeds: Sequence[int],
    target: Target | None = None,
) -> Plane:
    """Runs of a design's gains on a grid of constant delay and independent completion.

    Args:
        objective: The setting; its network is not read, its simulations are counted.
        design: Numbers; its deadline is not read: it is the delay.
        delays: [D] s.
        reliabilities: [F] completion probabilities.
        seeds: [S] at least two.
        target: Whose merits are kept.

    Raises:
        ValueError: A delay below 0, a probability outside [0, 1], one twice, or fewer than two seeds.
    """
    delay, reliability = _axis("delays", delays, None), _axis("reliabilities", reliabilities, 1.0)
    if len(seeds) < 2:
        raise ValueError(f"seeds: got {len(seeds)}, expected at least 2 for an interval")
    rows = [_row(objective, design, delay, float(part), seeds) for part in reliability]
    scores = [Scores.of(runs["auc"].values, objective.scale) for runs in rows]
    merits = [(target or Target()).merits(runs, score) for runs, score in zip(rows, scores, strict=True)]
    collided = np.stack([runs["collided"].values.astype(bool) for runs in rows])
    return Plane(delay, reliability, np.stack([score.values for score in scores]), np.stack(merits), collided,
                 objective.scenario.num_robots)  # fmt: skip


def _row(objective: Objective, design: Design, delay: np.ndarray, part: float, seeds: Sequence[int]) -> xr.Dataset:
    """Runs at one reliability, over (delay, seed)."""
    loss = Leg(loss=IndependentLoss(1.0 - part))
    # When a command takes effect depends on the deadline alone, so one network serves all delays; not so on arrival.
    apart = objective.rules.actuation == "arrival"
    parts = []
    for some in np.split(delay, delay.size) if apart else [delay]:
        compute = Constant(float(some[0])) if apart else Constant()
        setting = replace(objective, network=LoopNetwork(uplink=loss, compute=compute, name="plane"), simulations=0)
        parts.append(setting.runs(replace(design, deadline=some), seeds))
        objective.simulations += setting.simulations
    return parts[0] if len(parts) == 1 else xr.concat(parts, "design")


def largest_delay(plane: Plane, level: float, reliability: float, limit: float = 1.0) -> Bound:
    """Largest constant delay at which mean merits still reach a level, at a given reliability within the plane's.

    Args:
        plane: Of a design.
        level: Of the mean merit.
        reliability: Linear between those of the plane.
        limit: Largest share of runs with a collision, kept by the upper end of its interval.

    Raises:
        ValueError: The reliability lies outside the plane.
    """
    merits, over = (
        _at(plane.reliability, values, "reliability", reliability) for values in (plane.merits, plane.excess(limit))
    )
    return reach(plane.delay, merits, level, excess=over)


def smallest_reliability(plane: Plane, level: float, delay: float, limit: float = 1.0) -> Bound:
    """Smallest reliability at which mean merits reach a level, at a given constant delay (s) within the plane's.

    Args:
        plane: Of a design.
        level: Of the mean merit.
        delay: Linear between those of the plane.
        limit: Largest share of runs with a collision, kept by the upper end of its interval.

    Raises:
        ValueError: The delay lies outside the plane.
    """
    column = _at(plane.delay, np.swapaxes(plane.merits, 0, 1), "delay", delay)
    axis, over = plane.reliability[::-1], _at(plane.delay, plane.excess(limit).T, "delay", delay)[::-1]
    return bound_of(
        column[::-1], lambda means: last_reached(axis, means, level, NONE_ABOVE, excess=over), plane.reliability[0]
    )


def _at(axis: np.ndarray, merits: np.ndarray, name: str, value: float) -> np.ndarray:
    """Merits [C, ., S] at a value between two points of the axis [C], [., S]."""
    _checks.bounded(name, value, least=float(axis[0]), most=float(axis[-1]))
    k = int(np.clip(np.searchsorted(axis, value) - 1, 0, max(axis.size - 2, 0)))
    if axis.size == 1:
        return merits[0]
    part = (value - axis[k]) / (axis[k + 1] - axis[k])
    return (1.0 - part) * merits[k] + part * merits[k + 1]


def _axis(name: str, values: Sequence[float], most: float | None) -> np.ndarray:
    axis = np.sort(np.atleast_1d(np.asarray(_checks.bounded(name, values, least=0.0, most=most), float)))
    if axis.size == 0 or np.unique(axis).size != axis.size:
        raise ValueError(f"{name}: got {axis.tolist()}, expected at least one value, each once")
    return axis
