"""How far estimated gradients are from the truth, by estimator, deadline and horizon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from qocjax.figures.quantities import milliseconds
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["gradient_errors"]

_NUMBERS = ("horizon", "deadline", "truth", "bias", "bias_se", "spread")
_COLOURS = (*OKABE_ITO, "k")
_MARKERS = "osD^v*PX"
_APART = 0.02  # of the span of horizons, between lines that would hide each other


def gradient_errors(table: pd.DataFrame, *, width: float = DOUBLE_COLUMN, height: float = 4.6) -> Figure:
    """Draws bias, spread and sign agreement of each estimator over the horizon, a column for each deadline.

    Bias and spread are root mean squares over parameters and points, relative to that of the gradient itself: above 1
    (dashed) an estimate is worse than none. A bias below two of its standard errors has a hollow marker. Half of the
    signs (dashed) are right by chance.

    Args:
        table: horizon, deadline, estimator, truth, bias, bias_se, spread, sign_agreement: a row per parameter.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(table, "table", _NUMBERS, ("estimator", "sign_agreement"))
    means = _relative(table)
    deadlines, names = sorted(table["deadline"].unique()), list(dict.fromkeys(table["estimator"]))
    horizons = sorted(table["horizon"].unique())
    rows = {"bias": "Relative bias", "spread": "Relative spread", "sign_agreement": "Share of right signs"}
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        grid = figure.subplots(3, len(deadlines), sharex=True, sharey="row", squeeze=False)
        lines: list[Line2D] = []
        for panels, deadline in zip(grid.T, deadlines, strict=True):
            for axes, quantity in zip(panels, rows, strict=True):
                at = means.loc[deadline]
                lines = [_draw(axes, at.xs(name, level="estimator"), k, len(names), quantity, name)
                         for k, name in enumerate(names)]  # fmt: skip
                axes.axhline(0.5 if quantity == "sign_agreement" else 1.0, color=GREY, ls="--", lw=0.7, zorder=0)
                if quantity != "sign_agreement":
                    axes.set_yscale("log")
            panels[0].set_title(rf"$\Delta$ = {milliseconds(deadline)} ms")
            panels[-1].set_xlabel("Horizon (s)")
            panels[-1].set_xticks(horizons)
        for axes, label in zip(grid[:, 0], rows.values(), strict=True):
            axes.set_ylabel(label)
        figure.legend(lines, names, loc="outside upper center", ncols=4)
    return figure


def _relative(table: pd.DataFrame) -> pd.DataFrame:
    """Root mean squares over parameters relative to the truth, by deadline, horizon and estimator."""
    lengths = ["truth", "bias", "bias_se", "spread"]
    squares = table.assign(**{name: table[name] ** 2 for name in lengths})
    means = squares.groupby(["deadline", "horizon", "estimator"])[[*lengths, "sign_agreement"]].mean()
    for name in lengths[1:]:
        means[name] = (means[name] / means["truth"]) ** 0.5
    return means


def _draw(axes: Axes, rows: pd.DataFrame, k: int, count: int, quantity: str, name: str) -> Line2D:
    """Line k of `count`, over the horizons in the index of `rows`."""
    rows = rows.sort_index()
    horizons, values = rows.index.to_numpy(float), rows[quantity].to_numpy(float)
    shifted = horizons + _APART * (horizons[-1] - horizons[0]) * (k - (count - 1) / 2)
    colour, marker = _COLOURS[k % len(_COLOURS)], _MARKERS[k % len(_MARKERS)]
    (line,) = axes.plot(shifted, values, color=colour, marker=marker, ms=3.5, lw=0.9, label=name)
    if quantity == "bias":
        unsure = values < 2.0 * rows["bias_se"].to_numpy(float)
        axes.plot(shifted[unsure], values[unsure], ls="", color=colour, marker=marker, ms=3.5, mfc="w")
    return line
