"""What prediction gains the navigation stack: both stacks over the deadline, and their paired difference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qocjax.figures.quantities import DEADLINE_LABEL
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["prediction_gain"]

_NUMBERS = ("deadline", "sampled", "sampled_se", "predicted", "predicted_se")
_SHOWN = {"auc": "AUC (s)", "path_length": "Path length (m)", "collided": "Runs with a collision"}
_LINES = {
    "sampled": ("from the sampled pose", OKABE_ITO[1], "o"),
    "predicted": ("from the predicted pose", OKABE_ITO[0], "s"),
}


def prediction_gain(table: pd.DataFrame, *, width: float = DOUBLE_COLUMN, height: float = 3.6) -> Figure:
    """Draws AUC, path length and collisions over the deadline, a row for each scenario; bars are two standard errors.

    Args:
        table: scenario, metric, deadline, and mean and standard error of both stacks.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(table, "table", _NUMBERS, ("scenario", "metric"))
    scenarios = list(dict.fromkeys(table["scenario"]))
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        grid = figure.subplots(len(scenarios), len(_SHOWN), sharex=True, squeeze=False)
        for panels, scenario in zip(grid, scenarios, strict=True):
            for axes, (metric, label) in zip(panels, _SHOWN.items(), strict=True):
                _draw(axes, table[(table["scenario"] == scenario) & (table["metric"] == metric)], metric == "collided")
                axes.set_ylabel(label)
                axes.set_ylim(bottom=0)
            panels[1].set_title(scenario.capitalize())
        for axes in grid[-1]:
            axes.set_xlabel(DEADLINE_LABEL)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2, title="Rollouts start")
    return figure


def _draw(axes: Axes, rows: pd.DataFrame, share: bool) -> None:
    for name, (label, colour, marker) in _LINES.items():
        mean, half = rows[name], 2 * rows[f"{name}_se"]
        bars = np.minimum(half, [mean, (1.0 if share else np.inf) - mean])  # none beyond what can be
        axes.errorbar(
            1e3 * rows["deadline"], mean, bars, label=label, color=colour, marker=marker, ms=3.5, capsize=1.5,
            elinewidth=0.7,
        )  # fmt: skip
    axes.grid(axis="y", color=GREY, lw=0.3, alpha=0.4)
