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
    """Draws the policies' bars, AUC against the deadline and a QoC map for each sweep, and the run's trajectories.

    Args:
        results: Table of the study.
        policies: Table of its policies.
        run: A representative run.
        folder: Where the files go.

    Returns:
        The files, a PNG and a PDF of each figure.
    """
    files = save(policy_bars(policies), folder / "policies")
    sweeps = list(dict.fromkeys(results["sweep"]))
    if {"eta", "tau"} <= set(sweeps):
        files += save(auc_against_deadline(results, ["eta", "tau"]), folder / "auc_eta_tau")
    for sweep in sweeps:
        files += save(auc_against_deadline(results, sweep), folder / f"auc_{sweep}")
        files += save(qoc_map(results, policies, sweep), folder / f"qoc_{sweep}")
    return files + save(trajectories(run), folder / "trajectories")
