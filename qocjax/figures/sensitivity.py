"""What moves QoC: elasticities at the design and Sobol indices over the whole box."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qocjax.figures.quantities import PARAMETERS
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["sensitivity_bars"]

_ENDS = ("", "_low", "_high")
_ORDERS = {"first": "alone (first order)", "total": "with others (total)"}
_SYMBOLS = {name: parameter.symbol for name, parameter in PARAMETERS.items()} | {
    "omega_max": r"$\omega^\mathrm{max}$",
    "d_safe": r"$d_\mathrm{safe}$",
    "deadline": r"$\Delta$",
}


def sensitivity_bars(elasticities: pd.DataFrame, sobol: pd.DataFrame | None = None, *, height: float = 2.2) -> Figure:
    """Draws elasticities with their 95 % intervals, and beside them Sobol indices with theirs.

    Args:
        elasticities: parameter, elasticity, low, high.
        sobol: parameter, first and total with ends `_low` and `_high`; None leaves them out.
        height: Inches.

    Raises:
        ValueError: A table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(elasticities, "elasticities", ("elasticity", "low", "high"))
    if sobol is not None:
        check_table(sobol, "sobol", [f"{name}{end}" for name in ("first", "total") for end in _ENDS])
    with paper_style():
        figure = Figure(figsize=(SINGLE_COLUMN if sobol is None else DOUBLE_COLUMN, height), layout="constrained")
        axes = figure.subplots(1, 1 if sobol is None else 2, squeeze=False)[0]
        _draw_bars(axes[0], elasticities, "elasticity", ("low", "high"), 0.0, OKABE_ITO[0], "")
        axes[0].axvline(0.0, color=GREY, lw=0.6)
        axes[0].set_xlabel("Change of QoC per change of the parameter (% per %)")
        if sobol is not None:
            for name, shift, colour in (("first", -0.2, OKABE_ITO[1]), ("total", 0.2, OKABE_ITO[0])):
                ends = (f"{name}_low", f"{name}_high")
                _draw_bars(axes[1], sobol, name, ends, shift, colour, _ORDERS[name])
            axes[1].set_xlabel("Share of the variance of QoC over all bounds (Sobol index)")
            axes[1].legend(loc="best")
    return figure


def _draw_bars(
    axes: Axes, rows: pd.DataFrame, name: str, ends: tuple[str, str], shift: float, colour: str, label: str
) -> None:
    places = np.arange(len(rows)) + shift
    reach = np.abs(rows[list(ends)].to_numpy(float).T - rows[name].to_numpy(float))
    axes.barh(places, rows[name], 0.36 if shift else 0.6, xerr=reach, color=colour, edgecolor="k", lw=0.5, label=label,
              error_kw={"elinewidth": 0.7, "capsize": 1.6})  # fmt: skip
    axes.set_yticks(range(len(rows)), labels=[_SYMBOLS.get(one, one) for one in rows["parameter"]])
    axes.tick_params(axis="y", length=0)
    if not axes.yaxis_inverted():
        axes.invert_yaxis()
