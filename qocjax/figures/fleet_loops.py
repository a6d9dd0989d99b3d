"""How many loops complete as a fleet grows, and what one step of each kind would change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from qocjax.figures.quantities import DEADLINE_LABEL, RELIABILITY_LABEL
from qocjax.figures.style import GREY, OKABE_ITO, SINGLE_COLUMN, paper_style, sequence
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["completion_figure", "steps_figure"]

_SHOWN = 0.999  # share of the highest F from which on an axis shows nothing new


def completion_figure(
    completion: pd.DataFrame, points: pd.DataFrame, *, width: float = SINGLE_COLUMN, height: float = 2.6
) -> Figure:
    """Draws F(Δ) of each fleet with a band of one standard error, marked at the fleet's best deadline.

    Args:
        completion: A row per fleet and deadline.
        points: A row per fleet.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: A table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(completion, "completion", ("robots", "deadline", "reliability", "reliability_se"))
    check_table(points, "points", ("robots", "deadline", "reliability"))
    fleets = list(dict.fromkeys(completion["robots"]))
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        for robots, colour in zip(fleets, sequence(len(fleets)), strict=True):
            rows = completion[completion["robots"] == robots].sort_values("deadline")
            x, share, error = (rows[name].to_numpy(float) for name in ("deadline", "reliability", "reliability_se"))
            axes.plot(1e3 * x, share, color=colour, marker="." if x.size < 40 else None, ms=3, label=f"{robots}")
            error = np.nan_to_num(error)
            axes.fill_between(1e3 * x, share - error, share + error, color=colour, alpha=0.2, lw=0)
        best = points.sort_values("robots")
        colours = dict(zip(fleets, sequence(len(fleets)), strict=True))
        for row in best.itertuples():
            axes.plot([1e3 * row.deadline], [row.reliability], marker="*", ms=8, mec="k", mew=0.5, ls="",
                      color=colours.get(row.robots, GREY), zorder=5, clip_on=False)  # fmt: skip
        axes.set_xlabel(DEADLINE_LABEL)
        axes.set_ylabel(RELIABILITY_LABEL)
        axes.set_xlim(0.0, _end(completion, points))
        axes.set_ylim(0.0, 1.05 * max(float(completion["reliability"].max()), 0.05))
        columns = -(-len(fleets) // -(-len(fleets) // 7))  # rows of equal length, of 7 at most
        figure.legend(loc="outside upper center", ncols=columns, title="Robots; stars: the best deadline",
                      columnspacing=0.9, handlelength=1.2)  # fmt: skip
    return figure


def _end(completion: pd.DataFrame, points: pd.DataFrame) -> float:
    """Where the axis ends (ms): beyond all stars, and where the last curve has become flat."""
    top = completion.groupby("robots")["reliability"].transform("max")
    rising = completion.loc[completion["reliability"] < _SHOWN * top, "deadline"]
    last = float(completion["deadline"].max())
    return 1e3 * min(1.15 * max(float(rising.max()) if len(rising) else 0.0, float(points["deadline"].max())), last)


def steps_figure(steps: pd.DataFrame, *, width: float = SINGLE_COLUMN) -> Figure:
    """Draws the gain in QoC of one step of each kind with its 95 % interval, in their order.

    Grey bars are gains that are not told from zero. At the right is the QoC that the step leads to.

    Args:
        steps: A row per step.
        width: Inches.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(steps, "steps", ("robots", "gain", "gain_low", "gain_high", "gain_told", "qoc"), ("step",))
    gain, low, high = (steps[name].to_numpy(float) for name in ("gain", "gain_low", "gain_high"))
    told = steps["gain_told"].to_numpy(int)
    colours = np.where(told > 0, OKABE_ITO[0], np.where(told < 0, OKABE_ITO[1], "0.75"))
    place = np.arange(len(steps))[::-1]
    with paper_style():
        figure = Figure(figsize=(width, 0.75 + 0.21 * len(steps)), layout="constrained")
        axes = figure.add_subplot()
        axes.barh(place, gain, 0.62, color=colours, ec="k", lw=0.5, zorder=2)
        axes.errorbar(gain, place, xerr=np.clip([gain - low, high - gain], 0, None), fmt="none", ecolor="k", zorder=3,
                      elinewidth=0.7, capsize=1.6, capthick=0.7)  # fmt: skip
        axes.axvline(0.0, color="k", lw=0.6, zorder=1)
        axes.set_yticks(place, labels=steps["step"])
        axes.tick_params(axis="y", length=0)
        reach = max(float(np.nanmax(np.abs([low, high, gain]))), 1e-3)
        axes.set_xlim(
            1.1 * min(float(np.nanmin([low, gain])), -0.05 * reach),
            1.1 * max(float(np.nanmax([high, gain])), 0.05 * reach),
        )
        axes.set_xlabel(f"Gain in QoC of {int(steps['robots'].iloc[0])} robots")
        right = axes.secondary_yaxis("right")
        right.set_yticks(place, labels=[f"{value:.3f}" for value in steps["qoc"]])
        right.tick_params(length=0)
        right.set_ylabel("QoC with it", labelpad=2)
    return figure
