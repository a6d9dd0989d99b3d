"""S and E over configured delays (paper, "Normalized simulation-based and experimental observations"), and fitted S."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from qocjax.figures.quantities import RELIABILITY_LABEL
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["calibration_figure", "validation_figure"]

DELAY_LABEL = r"Configured delay $\varphi$ (ms)"
_LOOKS = {"simulated": (r"simulated $S(\varphi)$", OKABE_ITO[0], "o"),
          "measured": (r"measured $E(\varphi)$", OKABE_ITO[1], "s")}  # fmt: skip
_REGIMES = {"low-reliability": "0.45", "intermediate": "0.72", "delay-dominant": "0.88"}


def validation_figure(curve: pd.DataFrame, regimes: pd.DataFrame, *, width: float = SINGLE_COLUMN) -> Figure:
    """Draws both curves on the normalised scale and in seconds, with 95 % intervals, F(phi), and the regimes of both.

    Args:
        curve: A row per delay, of a `Validation`.
        regimes: A row per curve and regime, of the same.
        width: Inches.

    Raises:
        ValueError: A table is empty or lacks a column.
    """
    parts = ("", "_auc")
    check_table(curve, "curve", ("delay", "reliability", *(f"{name}{part}" for name in _LOOKS for part in parts)))
    if missing := {"curve", "regime", "shown", "begin", "end"} - set(regimes):
        raise ValueError(f"regimes: column '{sorted(missing)[0]}' is missing")
    with paper_style():
        figure = Figure(figsize=(width, 1.3 * width), layout="constrained")
        grid = figure.add_gridspec(3, 1, height_ratios=(0.32, 2.0, 1.5))
        top, lower = figure.add_subplot(grid[1]), figure.add_subplot(grid[2])
        strip = figure.add_subplot(grid[0], sharex=top)
        lower.sharex(top)
        _draw_curves(top, curve, "")
        _draw_reliability(top, curve)
        top.set_ylabel("Normalised AUC (%)")
        top.tick_params(labelbottom=False)
        _draw_curves(lower, curve, "_auc")
        _logarithmic(lower, curve)
        lower.set_xlabel(DELAY_LABEL)
        _draw_regimes(strip, regimes)
        delay = 1e3 * curve["delay"]
        top.set_xlim(delay.min() - 0.02 * np.ptp(delay), delay.max() + 0.02 * np.ptp(delay))
        handles = [Line2D([], [], color=colour, marker=marker, ms=3, label=label)
                   for label, colour, marker in _LOOKS.values()]  # fmt: skip
        handles.append(Line2D([], [], color=GREY, ls="--", lw=0.9, label=r"$F(\varphi)$"))
        patches = [Patch(fc=shade, ec="none", label=name) for name, shade in _REGIMES.items()]
        figure.legend(handles=[*handles, *patches], loc="outside upper center", ncols=3)
    return figure


def _draw_curves(axes: Axes, curve: pd.DataFrame, part: str) -> None:
    """Both curves with their intervals; no bar where there is one run alone."""
    delay = 1e3 * curve["delay"].to_numpy()
    for shift, (name, (_, colour, marker)) in zip((-1.0, 1.0), _LOOKS.items(), strict=True):
        value = curve[f"{name}{part}"].to_numpy(float)
        bars = np.stack([value - curve[f"{name}{part}_low"], curve[f"{name}{part}_high"] - value]).astype(float)
        apart = delay + shift * 0.002 * np.ptp(delay)  # so that bars at one delay do not lie on each other
        axes.errorbar(apart, value, yerr=np.nan_to_num(bars), color=colour, marker=marker, ms=2.6, lw=1.0,
                      elinewidth=0.7, capsize=1.2, capthick=0.6, zorder=3)  # fmt: skip


def _draw_reliability(axes: Axes, curve: pd.DataFrame) -> None:
    second = axes.twinx()
    second.plot(1e3 * curve["delay"], curve["reliability"], color=GREY, ls="--", lw=0.9)
    second.set_ylim(0.0, 1.04)
    second.set_ylabel(RELIABILITY_LABEL.replace(r"\Delta", r"\varphi"), color=GREY)
    second.tick_params(axis="y", colors=GREY)
    axes.set_zorder(second.get_zorder() + 1)
    axes.patch.set_visible(False)


def _logarithmic(axes: Axes, curve: pd.DataFrame) -> None:
    axes.set_yscale("log")
    axes.set_ylabel("AUC (s)")
    values = curve[[f"{name}_auc" for name in _LOOKS]].to_numpy()
    wide = values.max() > 20.0 * values.min()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 3.0, 5.0, 7.0), numticks=12))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _draw_regimes(axes: Axes, regimes: pd.DataFrame) -> None:
    """A bar for each curve, a shade for each regime that it shows."""
    names = list(_LOOKS)
    for row in regimes[regimes["shown"]].itertuples():
        axes.barh(names.index(row.curve), 1e3 * (row.end - row.begin), left=1e3 * row.begin, height=0.72,
                  color=_REGIMES[row.regime], lw=0)  # fmt: skip
    for row in regimes[regimes["shown"] & (regimes["regime"] != "delay-dominant")].itertuples():
        if np.isfinite(row.end_low) and row.end_high > row.end_low:
            axes.plot([1e3 * row.end_low, 1e3 * row.end_high], 2 * [names.index(row.curve)], color="k", lw=0.8,
                      marker="|", ms=3, mew=0.7)  # fmt: skip
    axes.set_ylim(1.5, -0.5)
    axes.set_yticks([0, 1], labels=["$S$", "$E$"])
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelbottom=False, length=0)
    for side in ("top", "right", "bottom", "left"):
        axes.spines[side].set_visible(False)


def calibration_figure(curve: pd.DataFrame, *, width: float | None = None, panel_height: float = 1.9) -> Figure:
    """Draws E with S before and after a fit, one panel for each setting, and under it what is left of the difference.

    Args:
        curve: A row per setting and delay, of `Judged`.
        width: Inches; by default one column for one setting, else two.
        panel_height: Inches.

    Raises:
        ValueError: The table is empty or lacks a column.
    """
    needed = ("delay", "measured", "before", "after", "left", "left_low", "left_high")
    check_table(curve, "curve", needed)
    settings = list(dict.fromkeys(curve["setting"]))
    columns = min(3, len(settings))
    rows = -(-len(settings) // columns)
    with paper_style():
        figure = Figure(figsize=(width or (SINGLE_COLUMN if columns == 1 else DOUBLE_COLUMN),
                                 0.35 + 1.45 * panel_height * rows), layout="constrained")  # fmt: skip
        grid = figure.add_gridspec(2 * rows, columns, height_ratios=[1.0, 0.45] * rows)
        for k, setting in enumerate(settings):
            row, column = divmod(k, columns)
            upper = figure.add_subplot(grid[2 * row, column])
            lower = figure.add_subplot(grid[2 * row + 1, column], sharex=upper)
            _draw_setting(upper, lower, curve[curve["setting"] == setting])
            if len(settings) > 1:
                upper.set_title(setting, fontsize=7.5)
            upper.tick_params(labelbottom=False)
            if column == 0:
                upper.set_ylabel("Normalised AUC (%)")
                lower.set_ylabel("$S - E$ (%)")
            if k + columns >= len(settings):
                lower.set_xlabel(DELAY_LABEL)
        figure.legend(handles=_calibration_handles(), loc="outside upper center", ncols=3)
    return figure


def _calibration_handles() -> Sequence[Line2D]:
    (_, blue, circle), (label, red, square) = _LOOKS.values()
    return [Line2D([], [], color=red, marker=square, ms=3, label=label),
            Line2D([], [], color=GREY, ls="--", lw=0.9, label=r"$S(\varphi)$ before"),
            Line2D([], [], color=blue, marker=circle, ms=3, label=r"$S(\varphi)$ fitted")]  # fmt: skip


def _draw_setting(upper: Axes, lower: Axes, curve: pd.DataFrame) -> None:
    (_, blue, circle), (_, red, square) = _LOOKS.values()
    delay = 1e3 * curve["delay"].to_numpy()
    upper.plot(delay, curve["before"], color=GREY, ls="--", lw=0.9)
    for name, colour, marker in (("measured", red, square), ("after", blue, circle)):
        upper.errorbar(delay, curve[name], yerr=np.nan_to_num(curve[f"{name}_half"].to_numpy(float)), color=colour,
                       marker=marker, ms=2.6, lw=1.0, elinewidth=0.7, capsize=1.2, capthick=0.6)  # fmt: skip
    lower.axhline(0.0, color="k", lw=0.5)
    lower.plot(delay, curve["before"] - curve["measured"], color=GREY, ls="--", lw=0.9)
    bars = np.stack([curve["left"] - curve["left_low"], curve["left_high"] - curve["left"]])
    lower.errorbar(delay, curve["left"], yerr=np.maximum(np.nan_to_num(bars), 0.0), color=blue, marker=circle, ms=2.6,
                   lw=1.0, elinewidth=0.7, capsize=1.2, capthick=0.6)  # fmt: skip
    lower.yaxis.set_major_locator(MaxNLocator(4))
