"""All figures of a study, as files."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from qocjax.figures.auc_deadline import auc_against_deadline
from qocjax.figures.policy_bars import policy_bars
from qocjax.figures.qoc_map import qoc_map
from qocjax.figures.save import save
from qocjax.figures.trajectories import RunLike, trajectories

__all__ = ["draw_study"]


def draw_study(results: pd.DataFrame, policies: pd.DataFrame, run: RunLike, folder: Path) -> list[Path]:
    """Draws the policies' bars, AUC against the deadline, a QoC map for each sweep, and the run's trajectories.

    AUC is drawn for the repulsion gain and the sampling period, as in the paper, or for what is swept without them.

    Args:
        results: Table of the study.
        policies: Table of its policies.
        run: A representative run.
        folder: Where the files go.

    Returns:
        The files, a PNG and a PDF of each figure.
    """
    sweeps = list(dict.fromkeys(results["sweep"]))
    lines = [sweep for sweep in sweeps if sweep in ("eta", "tau")] or sweeps
    figures = {
        "policies": policy_bars(policies),
        "auc_" + "_".join(lines): auc_against_deadline(results, lines),
        **{f"qoc_{sweep}": qoc_map(results, policies, sweep) for sweep in sweeps},
        "trajectories": trajectories(run),
    }
    return [path for name, figure in figures.items() for path in save(figure, folder / name)]
