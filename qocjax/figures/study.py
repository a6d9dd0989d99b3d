"""All figures of a study, as files."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import pandas as pd

from qocjax.figures.auc_deadline import auc_against_deadline
from qocjax.figures.beside import draw_all
from qocjax.figures.policy_bars import policy_bars
from qocjax.figures.qoc_map import qoc_map
from qocjax.figures.trajectories import RunLike, trajectories

__all__ = ["draw_study"]


def draw_study(
    results: pd.DataFrame,
    policies: pd.DataFrame,
    run: RunLike,
    folder: Path,
    pool: Executor | None = None,
    limit: float | None = None,
) -> list[Path]:
    """Draws the policies' bars, AUC against the deadline, a QoC map for each sweep, and the run's trajectories.

    AUC is drawn for the repulsion gain and the sampling period, as in the paper, or for what is swept without them.

    Args:
        results: Table of the study.
        policies: Table of its policies.
        run: A representative run.
        folder: Where the files go.
        pool: A process that helps, from `process_beside`.
        limit: Largest share of runs with a collision; None for none.

    Returns:
        The files, a PNG and a PDF of each figure.
    """
    sweeps = list(dict.fromkeys(results["sweep"]))
    lines = [sweep for sweep in sweeps if sweep in ("eta", "tau")] or sweeps
    figures = {
        "policies": partial(policy_bars, policies),
        "auc_" + "_".join(lines): partial(auc_against_deadline, results, lines),
        **{f"qoc_{sweep}": partial(qoc_map, results, policies, sweep, limit=limit) for sweep in sweeps},
        "trajectories": partial(trajectories, run),
    }
    return draw_all([(make, folder / name) for name, make in figures.items()], pool)
