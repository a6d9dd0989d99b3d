"""AUC against the deadline for each value of a parameter (paper, "AUC variation for selected control parameters")."""

from __future__ import annotations

import string
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import FixedLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from qocjax.figures.quantities import DEADLINE_LABEL, RELIABILITY_LABEL, parameter
from qocjax.figures.style import DOUBLE_COLUMN, GREY, SINGLE_COLUMN, paper_style, sequence
from qocjax.figures.tables import baseline_index, check_table, grid, sweep_rows

__all__ = ["auc_against_deadline"]

_COLUMNS = ("sweep", "value", "deadline", "reliability", "auc", "auc_se")
_RELIABLE = 0.5  # F(Δ) from which on the loop works and small differences in AUC matter
_WIDE = 4.0  # largest ratio of AUC that a linear axis shows well
_LINEAR_SHARE = 0.68  # of the height, for the reliable region where the axis is split


def auc_against_deadline(
    results: pd.DataFrame,
    sweeps: str | Sequence[str] = ("eta", "tau"),
    *,
    baseline: Mapping[str, float] | None = None,
    width: float | None = None,
    panel_height: float = 2.5,
) -> Figure:
    """Draws AUC over Δ, one line per value with a band of one standard error, and F(Δ) on a second axis.

    Where few loops complete, AUC is tens of times what it is elsewhere. The axis is then linear up to the largest AUC
    of the reliable region, F(Δ) ≥ 0.5, and logarithmic above; a line marks the change. Where the reliable region too
    spans much, the axis is logarithmic throughout.

    Args:
        results: One row per sweep, value and deadline.
        sweeps: The parameters, one panel each; panels whose AUC axis has the same form share it.
        baseline: Baseline values by parameter, to be emphasised. Those not given are read from the other sweeps.
        width: Inches; by default one column for one panel, else two.
        panel_height: Inches per row of panels.

    Returns:
        The figure.

    Raises:
        ValueError: The table is empty, lacks a column or a sweep, or holds what cannot be drawn.
    """
    check_table(results, "results", _COLUMNS)
    names = [sweeps] if isinstance(sweeps, str) else list(sweeps)
    if not names:
        raise ValueError("sweeps: expected at least one parameter, got none")
    tables = [sweep_rows(results, "results", name) for name in names]
    if width is None:
        width = SINGLE_COLUMN if len(names) == 1 else DOUBLE_COLUMN
    forms = {_form(table) for table in tables}
    shared = len(forms) == 1 and forms == {_form(pd.concat(tables))}
    with paper_style():
        figure, panels = _panels(len(names), width, panel_height, shared)
        for index, (panel, name, table) in enumerate(zip(panels, names, tables, strict=True)):
            chosen = baseline_index(results, name, np.unique(table["value"]), baseline)
            mark = f"({string.ascii_lowercase[index]}) " if len(names) > 1 else ""
            _draw_values(panel, mark, name, table, chosen)
            place = panel.get_subplotspec()
            outermost = index == len(names) - 1 or (place is not None and place.is_last_col())
            _draw_reliability(panel, table, outermost)
            _set_scale(panel, pd.concat(tables) if shared else table)
    return figure


def _panels(count: int, width: float, height: float, shared: bool) -> tuple[Figure, list[Axes]]:
    """Lays out the panels, with labels at the outside only."""
    columns = min(count, max(1, round(width / SINGLE_COLUMN)))
    rows = -(-count // columns)
    figure = Figure(figsize=(width, height * rows), layout="constrained")
    panels: list[Axes] = []
    for index in range(count):
        panel = figure.add_subplot(rows, columns, index + 1, sharex=panels[0] if panels else None)
        left, lowest = index % columns == 0, index + columns >= count
        panel.set_ylabel("AUC (s)" if left else "")
        panel.set_xlabel(DEADLINE_LABEL if lowest else "")
        panel.tick_params(labelleft=left or not shared, labelbottom=lowest)
        panels.append(panel)
    return figure, panels


def _draw_values(panel: Axes, mark: str, sweep: str, table: pd.DataFrame, chosen: int | None) -> None:
    values, deadlines, auc = grid(table, "auc")
    error = grid(table, "auc_se")[2]
    marker = "o" if deadlines.size < 12 else ""
    for index, (value, shade) in enumerate(zip(values, sequence(values.size), strict=True)):
        emphasised = index == chosen
        colour = "k" if emphasised else shade
        text = parameter(sweep).format(value) + (" (baseline)" if emphasised else "")
        panel.plot(1e3 * deadlines, auc[index], color=colour, lw=1.6 if emphasised else 0.9,
                   marker=marker, ms=2.5, clip_on=not marker, zorder=3.5 if emphasised else 3, label=text)  # fmt: skip
        low, high = auc[index] - error[index], auc[index] + error[index]
        panel.fill_between(1e3 * deadlines, low, high, color=colour, alpha=0.3, lw=0)
        if deadlines.size == 1:  # a band needs two
            panel.vlines(1e3 * deadlines, low, high, color=colour, lw=0.7)
    if deadlines.size == 1:
        panel.set_xticks(1e3 * deadlines)
    shown = parameter(sweep)
    panel.legend(title=f"{mark}{shown.name} {shown.label}", loc="lower center", bbox_to_anchor=(0.5, 1.0),
                 ncols=min(4, values.size))  # fmt: skip


def _draw_reliability(panel: Axes, table: pd.DataFrame, outermost: bool) -> None:
    """Draws F(Δ) on a second axis behind the lines; a band where it differs between the values."""
    grouped = table.groupby("deadline")["reliability"]
    deadlines = 1e3 * np.array(sorted(grouped.groups), dtype=float)
    second = panel.twinx()
    second.plot(deadlines, grouped.mean(), color=GREY, ls="--", lw=0.9, marker="s" if deadlines.size < 12 else "", ms=2)
    second.fill_between(deadlines, grouped.min(), grouped.max(), color=GREY, alpha=0.2, lw=0)
    second.margins(x=0.0)
    second.set_ylim(0.0, 1.04)
    second.set_yticks(np.linspace(0.0, 1.0, 6))
    second.tick_params(axis="y", colors=GREY)
    if outermost:
        second.set_ylabel(RELIABILITY_LABEL, color=GREY)
    else:
        second.tick_params(axis="y", labelright=False)
    share = grouped.mean().to_numpy(float)
    if share[0] < 0.5 <= share[-1]:
        middle = float(np.interp(0.5, share, deadlines))
        text = panel.annotate(r"$F(\Delta)$", (middle, 0.5), (4, 0), xycoords=second.transData, zorder=5,
                              textcoords="offset points", va="center", color=GREY)  # fmt: skip
        text.set_path_effects([Stroke(linewidth=2.0, foreground="w"), Normal()])
    panel.set_zorder(second.get_zorder() + 1)
    panel.patch.set_visible(False)


def _limits(table: pd.DataFrame) -> tuple[float, float, float]:
    """Returns the smallest AUC, the upper end of the reliable region, and the largest AUC with its error."""
    auc = table["auc"]
    reliable = auc[table["reliability"] >= _RELIABLE]
    high = float((auc + table["auc_se"].fillna(0.0)).max())
    return float(auc.min()), 1.03 * float(reliable.max()) if len(reliable) else high, high


def _form(table: pd.DataFrame) -> str:
    """Chooses the form of the AUC axis, see `auc_against_deadline`."""
    low, cut, high = _limits(table)
    if low <= 0.0 or high <= max(_WIDE * low, 0.0 if cut > _WIDE * low else 1.5 * cut):
        return "linear"
    return "split" if cut <= _WIDE * low else "log"


def _set_scale(panel: Axes, table: pd.DataFrame) -> None:
    """Fits the AUC axis to the data, in its form."""
    low, cut, high = _limits(table)
    form = _form(table)
    if form == "split":
        _split(panel, low, cut, high)
    elif form == "log":
        panel.set_yscale("log")
        panel.set_ylim(low / 1.15, high * 1.15)
        panel.yaxis.set_minor_formatter(NullFormatter())
    else:
        margin = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
        panel.set_ylim(low - margin, high + margin)
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


def _split(panel: Axes, low: float, cut: float, high: float) -> None:
    """Makes the AUC axis linear from `low` to `cut` and logarithmic from there to `high`."""
    bottom, top = low - 0.06 * (cut - low), 1.3 * high
    decades = _LINEAR_SHARE / (1.0 - _LINEAR_SHARE) * cut * np.log10(top / cut) / (cut - bottom)
    panel.set_yscale("symlog", linthresh=cut, linscale=0.9 * decades)  # matplotlib divides by 1 - 1/base
    panel.set_ylim(bottom, top)
    powers = 10.0 ** np.arange(np.floor(np.log10(cut)), np.ceil(np.log10(top)))
    steps = np.outer(powers, np.arange(1, 10)).ravel()
    labelled = powers[powers > cut] if (powers > cut).any() else steps[(steps > cut) & (steps < top)][:1]
    first = _LINEAR_SHARE + (1.0 - _LINEAR_SHARE) * np.log(labelled[:1] / cut) / np.log(top / cut)
    ticks = np.asarray(MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(low, cut))
    heights = _LINEAR_SHARE * (ticks - bottom) / (cut - bottom)
    apart = (heights >= 0.0) & (heights <= min([_LINEAR_SHARE, *(first - 0.08)]))  # labels must not touch
    panel.yaxis.set_major_locator(FixedLocator([*ticks[apart], *labelled]))
    panel.yaxis.set_minor_locator(FixedLocator(list(steps[(steps > cut) & (steps < top)])))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.axhline(cut, color="k", lw=0.4, zorder=1)
    panel.annotate("logarithmic above, linear below", (1, cut), (-2, 1), xycoords=("axes fraction", "data"),
                   textcoords="offset points", ha="right", va="bottom", fontsize=6.5, color=GREY)  # fmt: skip
