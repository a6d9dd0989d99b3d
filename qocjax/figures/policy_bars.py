"""QoC of the three policies in each sweep, as grouped bars (paper, "Parameter sweep")."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from qocjax.figures.quantities import milliseconds, parameter, value_text
from qocjax.figures.style import DOUBLE_COLUMN, POLICIES, paper_style
from qocjax.figures.tables import check_table, policy_rows, present_sweeps

__all__ = ["policy_bars"]

_COLUMNS = ("sweep", "policy", "value", "deadline", "qoc", "qoc_low", "qoc_high", "difference_low", "difference_high")
_BAR = 0.28  # width, in distances between two groups
_WIDEST = 0.45  # inches per bar
_NARROW = 0.22  # inches per bar below which the numbers under it are written upwards
_CROSS: dict = {"ls": "", "marker": "x", "ms": 4, "mew": 1.2, "color": "k"}


def policy_bars(policies: pd.DataFrame, *, width: float = DOUBLE_COLUMN, height: float = 2.3) -> Figure:
    """Draws the QoC of each policy in each sweep with its 95 % interval, and the chosen Θ and Δ under each bar.

    A cross at the foot of a bar says that its choice is not shown to keep the limit on collisions.

    "n.s." over a bar says that the interval of its paired difference from Co-design contains zero: two bars whose own
    intervals overlap may still differ, since all designs see the same random numbers (model, section 6).

    Args:
        policies: One row per sweep and policy.
        width: Inches.
        height: Inches.

    Returns:
        The figure, with one container of bars per policy.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(policies, "policies", _COLUMNS)
    sweeps = present_sweeps(policies)
    chosen = {(sweep, name): row for sweep in sweeps for name, row in policy_rows(policies, sweep)}
    names = [name for name in POLICIES if any((sweep, name) in chosen for sweep in sweeps)]
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        span = max(len(sweeps), (width - 0.6) * _BAR / _WIDEST)  # groups that would fit
        upright = (width - 0.6) * _BAR / span >= _NARROW
        bars = [_draw_policy(axes, name, sweeps, chosen, upright) for name in names]
        _label_groups(axes, sweeps, upright)
        axes.set_xlim(0.5 * (len(sweeps) - 1 - span), 0.5 * (len(sweeps) - 1 + span))
        top = float(np.fmax(policies["qoc"], policies["qoc_high"]).max())
        axes.set_ylim(0.0, 1.1 * top if top > 0 else 1.0)
        axes.set_ylabel("QoC")
        handles: list = [bar.patches[0] for bar in bars]
        if "within_limit" in policies and not policies["within_limit"].all():
            handles, names = [*handles, Line2D([], [], **_CROSS)], [*names, "too many collisions"]
        figure.legend(handles, names, loc="outside upper center", ncols=len(names))
    return figure


def _draw_policy(
    axes: Axes, name: str, sweeps: list[str], chosen: dict[tuple[str, str], pd.Series], upright: bool
) -> BarContainer:
    """Draws one policy's bar in every group that has it, with whiskers and the numbers below."""
    groups = [group for group, sweep in enumerate(sweeps) if (sweep, name) in chosen]
    rows = pd.DataFrame([chosen[sweeps[group], name] for group in groups])
    x = np.array(groups) + _BAR * (list(POLICIES).index(name) - 1)
    qoc, low, high = rows[["qoc", "qoc_low", "qoc_high"]].to_numpy(float).T
    look = POLICIES[name]
    bars = axes.bar(x, qoc, _BAR, color=look.colour, edgecolor="k", lw=0.5, hatch=look.hatch, label=name)
    whiskers = np.clip([qoc - low, high - qoc], 0.0, None)  # rounding may put an end on the wrong side
    axes.errorbar(x, qoc, whiskers, fmt="none", ecolor="k", elinewidth=0.7, capsize=1.6, capthick=0.7)
    for position, group, (_, row) in zip(x, groups, rows.iterrows(), strict=True):
        _write_choice(axes, position, sweeps[group], row, upright)
        if name != "Co-design" and row["difference_low"] <= 0.0 <= row["difference_high"]:
            top = np.fmax(row["qoc"], row["qoc_high"])
            axes.annotate("n.s.", (position, top), (0, 1.5), textcoords="offset points", ha="center", fontsize=6.5)
    if "within_limit" in rows:
        _cross_out(axes, x[~rows["within_limit"].to_numpy(bool)])
    return bars


def _cross_out(axes: Axes, x: np.ndarray) -> None:
    """Marks bars that are not to be driven."""
    for at in x:
        (cross,) = axes.plot([at], [0.05], transform=axes.get_xaxis_transform(), zorder=4, **_CROSS)
        cross.set_path_effects([Stroke(linewidth=3.0, foreground="w"), Normal()])


def _write_choice(axes: Axes, x: float, sweep: str, row: pd.Series, upright: bool) -> None:
    value, deadline, _ = _depths(upright)
    choice = {value: value_text(row), deadline: milliseconds(row["deadline"])}
    for depth, text in choice.items():
        _write_below(axes, text, x, depth, fontsize=7, rotation=0 if upright else 90)


def _label_groups(axes: Axes, sweeps: list[str], upright: bool) -> None:
    """Names each group by its parameter, and the two lines of numbers at their left."""
    value, deadline, group = _depths(upright)
    for index, sweep in enumerate(sweeps):
        _write_below(axes, parameter(sweep).label, index, group, fontsize=8)
    for depth, text in ((value, r"$\Theta$"), (deadline, r"$\Delta$ (ms)")):
        axes.annotate(text, (0, 0), (-3, -depth), xycoords="axes fraction", textcoords="offset points",
                      ha="right", va="center", fontsize=7)  # fmt: skip
    axes.set_xticks(np.arange(1, len(sweeps)) - 0.5, labels=[])
    axes.tick_params(axis="x", length=0)


def _depths(upright: bool) -> tuple[float, float, float]:
    """Returns how far below the axis Θ, Δ and the group's name are centred, in points."""
    return (7.0, 16.0, 27.5) if upright else (9.5, 25.0, 40.0)


def _write_below(axes: Axes, text: str, x: float, depth: float, *, fontsize: float, rotation: float = 0) -> None:
    axes.annotate(text, (x, 0), (0, -depth), xycoords=("data", "axes fraction"), textcoords="offset points",
                  ha="center", va="center", fontsize=fontsize, rotation=rotation)  # fmt: skip
