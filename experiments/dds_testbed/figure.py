"""The figure of the comparison: distributions of the loop time, and the model's numbers against the measured ones."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.dds_testbed.cases import CASES, LEVELS, PROFILES
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style

__all__ = ["draw"]

_LABELS = {"best_effort": "BEST_EFFORT", "reliable_1": "RELIABLE, depth 1", "reliable_10": "RELIABLE, depth 10"}
_COLOURS = dict(zip(PROFILES, OKABE_ITO, strict=False))
_MARKERS = dict(zip(PROFILES, "ov^", strict=True))
_SHOWN = ((0.05, False), (0.1, False), (0.2, False), (0.1, True))


def draw(table: pd.DataFrame, quantiles: pd.DataFrame, modelled: dict[str, np.ndarray]) -> Figure:
    """Draws the comparison.

    Args:
        table: Of `compare`.
        quantiles: Measured quantiles of the loop time, a column per case (s).
        modelled: Loop times of the model by case, any shape (s).
    """
    with paper_style():
        figure, axes = plt.subplots(2, 4, figsize=(DOUBLE_COLUMN, 3.9), layout="constrained")
        for k, ((loss, bursty), axis) in enumerate(zip(_SHOWN, axes[0], strict=True)):
            _distributions(axis, loss, bursty, quantiles, modelled)
            axis.set_ylabel("share of loops" if k == 0 else "")
        for axis, (number, title, factor) in zip(
            axes[1],
            (("lost", "lost loops (%)", 100.0), ("p95", "95th percentile (ms)", 1e3),
             ("age_mean", "mean age (ms)", 1e3), ("qoc", "QoC", 1.0)),
            strict=True,
        ):  # fmt: skip
            _against(axis, table[table["number"] == number], factor)
            axis.set_title(title)
        axes[1, 0].set_ylabel("model")
        lines = [Line2D([], [], color=_COLOURS[p], marker=_MARKERS[p], ms=3.5, label=_LABELS[p]) for p in PROFILES]
        lines += [
            Line2D([], [], color=GREY, ls=style, label=name) for style, name in (("-", "measured"), ("--", "model"))
        ]
        figure.legend(handles=lines, loc="outside lower center", ncols=5)
        plt.close(figure)
    return figure


def _distributions(
    axis: Axes, loss: float, bursty: bool, quantiles: pd.DataFrame, modelled: dict[str, np.ndarray]
) -> None:
    for case in CASES:
        if (case.loss, case.bursty) != (loss, bursty):
            continue
        below = case.profile == "best_effort"  # which RELIABLE of depth 1 would hide
        style = {"color": _COLOURS[case.profile], "lw": 2.4 if below else 0.9, "alpha": 0.5 if below else 1.0}
        axis.plot(1e3 * quantiles[case.name], LEVELS, ls="-", **style)
        found = np.quantile(modelled[case.name], LEVELS, method="inverted_cdf")
        axis.plot(1e3 * found, LEVELS, ls="--", **style)
    axis.set(
        xscale="log", xlim=(8, 1000), ylim=(0, 1.02), title=f"{100 * loss:g} % loss{', in bursts' if bursty else ''}"
    )
    axis.set_xticks([10, 100, 1000], ["10", "100", "1000"])
    axis.set_xlabel("loop time (ms)")


def _against(axis: Axes, rows: pd.DataFrame, factor: float) -> None:
    for row in rows.itertuples():
        axis.errorbar(
            factor * row.measured, factor * row.model, yerr=factor * row.spread, color=_COLOURS[row.profile],
            marker=_MARKERS[row.profile], ms=3.5, lw=0.6, mfc="none" if row.bursty else None,
        )  # fmt: skip
    low, high = min(axis.get_xlim()[0], axis.get_ylim()[0]), max(axis.get_xlim()[1], axis.get_ylim()[1])
    axis.plot([low, high], [low, high], color=GREY, lw=0.6, zorder=0)
    axis.set(xlim=(low, high), ylim=(low, high), xlabel="measured")
