"""How a grid of designs x seeds is cut into batches: the layout of the batch lives here alone.

All runs of a batch share tau and the deadline, so that one row of the command buffer is due for all of them and nothing
is gathered per run. Arrays are [N, designs, seeds] with the seeds last: what depends on the seed alone (loop times,
schedule, start, reference) is stored once and read along the vector lanes, what depends on the design is one number per
row of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from qocjax.network.schedule import Rules, split_deadline
from qocjax.scenario import num_ticks

__all__ = ["Batch", "Group", "batches_of", "groups_of"]

MAX_SEEDS = 64  # seeds of one batch: whole vector registers, and few enough for many designs beside them


@dataclass(frozen=True)
class Group:
    """All designs of one sampling period and deadline."""

    tau: float
    deadline: float
    ticks: int
    mid_tick: bool
    slots: int  # capacity of the command buffer: of the longest deadline at this tau, so that one program serves all
    designs: np.ndarray  # indices into the grid


@dataclass(frozen=True)
class Batch:
    """One call of the compiled loop; short ones are filled up by repeating the last index, to keep the shape."""

    group: Group
    designs: np.ndarray  # [rows] indices into the grid
    seeds: np.ndarray  # [lanes] indices into the seeds
    num_designs: int  # of the rows, how many are real
    num_seeds: int  # of the lanes, how many are real


def groups_of(tau: np.ndarray, deadline: np.ndarray, horizon: float, rules: Rules) -> list[Group]:
    """Groups the designs of a grid (tau [G], deadline [G], s) by sampling period, then deadline."""
    groups = []
    for period in np.unique(tau):
        members = np.flatnonzero(tau == period)
        ticks = num_ticks(horizon, period)
        lags = [int(split_deadline(np.float64(d), np.float64(period))[0]) for d in np.unique(deadline[members])]
        slots = 1 if rules.actuation == "instant" else min(max(lags), ticks) + 2
        for limit in np.unique(deadline[members]):
            rest = float(split_deadline(np.float64(limit), np.float64(period))[1])
            mid_tick = rules.actuation == "deadline" and rest > 0
            chosen = members[deadline[members] == limit]
            groups.append(Group(float(period), float(limit), ticks, mid_tick, slots, chosen))
    return groups


def batches_of(groups: list[Group], num_seeds: int, num_robots: int, max_runs: int) -> Iterator[Batch]:
    """Cuts groups into batches of about `max_runs` runs, those that share loop times one after the other.

    Args:
        groups: From `groups_of`.
        num_seeds: S.
        num_robots: N; a batch holds fewer runs where each has more robots.
        max_runs: Runs of a batch with two robots.
    """
    lanes = min(num_seeds, MAX_SEEDS)
    for tau in dict.fromkeys(group.tau for group in groups):
        for first in range(0, num_seeds, lanes):
            seeds, real_seeds = _filled(np.arange(first, min(first + lanes, num_seeds)), lanes)
            for group in (g for g in groups if g.tau == tau):
                budget = max(1, max_runs * 2 // (max(num_robots, 2) * lanes))
                parts = -(-len(group.designs) // budget)
                rows = -(-len(group.designs) // parts)
                for start in range(0, len(group.designs), rows):
                    designs, real_designs = _filled(group.designs[start : start + rows], rows)
                    yield Batch(group, designs, seeds, real_designs, real_seeds)


def _filled(indices: np.ndarray, length: int) -> tuple[np.ndarray, int]:
    return np.pad(indices, (0, length - len(indices)), mode="edge"), len(indices)
