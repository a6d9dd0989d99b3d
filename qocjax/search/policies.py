"""The best one-at-a-time designs under limits: what a joint search has to beat."""

from __future__ import annotations

import numpy as np
import pandas as pd

from qocjax.search.trial import Problem
from qocjax.study.grid import Grid
from qocjax.study.policies import MIN_RELIABILITY, POLICIES

__all__ = ["policy_designs"]


def policy_designs(
    problem: Problem, grid: Grid, seeds: range, min_reliability: float = MIN_RELIABILITY
) -> pd.DataFrame:
    """The best design of each of the paper's policies over all one-at-a-time sweeps, under the limits of a problem.

    A policy takes the best of its sweeps' choices on these seeds; designs that break the limits are left out, and a
    policy with none left is left out too.

    Args:
        problem: Objective and limits; the grid takes the place of its space.
        grid: From `one_at_a_time`.
        seeds: On which the policies choose.
        min_reliability: What MinDelay asks of F(Delta).

    Returns:
        One row per policy with `policy`, `sweep`, the simulations of all sweeps and the values of its design, best
        first.
    """
    scores, collided = problem.simulate(grid.designs, seeds)
    excess = problem.excess(grid.designs, collided, cautious=True)
    allowed = np.where(excess > 0, np.nan, problem.measure(scores))[grid.design]
    known = problem.objective.reliability(grid.designs.deadline, grid.designs.tau)
    rows = []
    for name, policy in POLICIES.items():
        choices = []
        for sweep in dict.fromkeys(grid.sweep):
            members = grid.rows(sweep)
            table = allowed[members]
            reliability = known.share[grid.design[members]]
            try:
                value, deadline = policy(table, reliability, min_reliability)
            except ValueError:  # nothing but NaN where the policy looks, or no deadline with enough reliability
                continue
            choices.append((table[value, deadline], sweep, int(grid.design[members[value, deadline]])))
        if choices:
            score, sweep, place = max(choices)
            values = {name: float(np.asarray(value)[place]) for name, value in grid.designs.values().items()}
            head = {"policy": name, "sweep": sweep, "simulations": scores.size, "chosen_at": float(score)}
            rows.append(head | values)
    return pd.DataFrame(rows).sort_values("chosen_at", ascending=False, ignore_index=True) if rows else pd.DataFrame()
