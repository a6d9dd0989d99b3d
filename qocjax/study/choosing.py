"""What each policy takes from a sweep, with and without a limit on collisions (model, section 6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from qocjax.study.grid import Grid
from qocjax.study.policies import POLICIES, NoDesignError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Pick", "least_seeds", "moved_by_limit", "picks", "places_of"]


class Pick(NamedTuple):
    """A policy's choice in a sweep, as rows of the results; None where every design diverged or failed."""

    sweep: str
    policy: str
    row: int | None  # within the limit where some design there is, else the choice without a limit
    free: int | None  # the choice without a limit
    kept: bool  # whether `row` keeps the limit on the seeds of the choice


def picks(results: pd.DataFrame, grid: Grid, min_reliability: float, limit: float | None) -> list[Pick]:
    """Lets each policy choose in each sweep.

    A design that diverged in any run is not to be chosen.

    Args:
        results: Of the grid, on the seeds of the choice.
        grid: Its rows.
        min_reliability: What MinDelay asks of F(Delta).
        limit: Largest share of runs with a collision; None for none.
    """
    sound = np.where(results["diverged_share"] > 0, np.nan, results["qoc"])
    safe = sound if limit is None else np.where(results["collision_share"] <= limit, sound, np.nan)
    chosen = []
    for sweep in dict.fromkeys(grid.sweep):
        rows = grid.rows(sweep)
        reliability = results["reliability"].to_numpy()[rows]
        for policy in POLICIES:
            free, within = (_row(policy, rows, scores, reliability, min_reliability) for scores in (sound, safe))
            chosen.append(Pick(sweep, policy, free if within is None else within, free, within is not None))
    return chosen


def _row(
    policy: str, rows: np.ndarray, scores: np.ndarray, reliability: np.ndarray, min_reliability: float
) -> int | None:
    try:
        value, deadline = POLICIES[policy](scores[rows], reliability, min_reliability)
    except NoDesignError:
        return None
    return int(rows[value, deadline])


def places_of(chosen: Sequence[Pick], grid: Grid) -> dict[int, int]:
    """Place of each chosen design among those that are judged, by its row; distinct designs, in their order."""
    rows = sorted({row for pick in chosen for row in (pick.row, pick.free) if row is not None})
    designs = np.unique(grid.design[rows]).tolist() if rows else []
    return {row: designs.index(int(grid.design[row])) for row in rows}


def moved_by_limit(policies: pd.DataFrame) -> pd.DataFrame:
    """The rows of a table of policies that a limit on collisions made another choice."""
    apart = [policies[f"unconstrained_{name}"] != policies[name] for name in ("value", "deadline")]
    return policies[(apart[0] | apart[1]) & policies["unconstrained_qoc"].notna()]


def least_seeds(limit: float) -> int:
    """Seeds of which none may collide so that the upper 95 % limit of the share lies within a limit."""
    return int(np.ceil(np.log(0.025) / np.log1p(-limit))) if 0.0 < limit < 1.0 else 1
