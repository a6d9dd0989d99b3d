"""The figure of the comparison: what was measured in each cell, coloured by the model's error."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.dds_testbed.cases import CHANNELS, LEVELS, PROFILES, Case
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style

__all__ = ["draw"]

_NAMES = {"cyclonedds": "Cyclone DDS", "fastdds": "Fast DDS", "zenoh": "Zenoh"}
_LABELS = {
    "best_effort": "BEST_EFFORT", "reliable_1": "RELIABLE, 1", "reliable_10": "RELIABLE, 10",
    "reliable_all": "RELIABLE, all", "best_effort_udp": "BEST_EFFORT, UDP",
    "reliable_10_fast": "RELIABLE, 10, 20 ms",
}  # fmt: skip
_SHOWN = (
    ("lost", "lost loops (%)", 100.0),
    ("p50", "median loop time (ms)", 1e3),
    ("p95", "95th percentile (ms)", 1e3),
    ("age_mean", "mean age of the command (ms)", 1e3),
    ("qoc", "QoC", 1.0),
)
_COLOURS = ("#f2f2f2", "#c7e5d8", "#fbe3a6", "#f3b5a5")
_MEANINGS = ("no model", "within the aim", "missed, within two standard errors", "missed")
_CURVES = ((0.1, False), (0.1, True))


def draw(table: pd.DataFrame, quantiles: pd.DataFrame, modelled: Mapping[str, np.ndarray]) -> Figure:
    """Draws the comparison.

    Args:
        table: Of `compare`.
        quantiles: Measured quantiles of the loop time, a column per case (s).
        modelled: Loop times of the model by case's name, any shape (s).
    """
    with paper_style():
        figure, axes = plt.subplots(4, 2, figsize=(DOUBLE_COLUMN, 9.2), layout="constrained")
        rows = [(middleware, profile) for middleware in PROFILES for profile in PROFILES[middleware]]
        for axis, (number, title, factor) in zip(axes.ravel(), _SHOWN, strict=False):
            _cells(axis, table[table["number"] == number], rows, factor)
            axis.set_title(title)
        for axis, channel in zip(axes.ravel()[len(_SHOWN) :], _CURVES, strict=False):
            _distributions(axis, channel, quantiles, modelled)
        _legend(axes[3, 1])
        plt.close(figure)
    return figure


def _cells(axis: Axes, rows: pd.DataFrame, profiles: list[tuple[str, str]], factor: float) -> None:
    """A table: profiles down, channels across, the measured number in each cell."""
    colours = np.zeros((len(profiles), len(CHANNELS)))
    for row in rows.itertuples():
        y, x = profiles.index((row.middleware, row.profile)), CHANNELS.index((row.loss, row.bursty))
        if not np.isnan(row.model):
            met = row.met == "yes" or (row.met not in ("yes", "no") and row.chance)
            colours[y, x] = 1 if met else 2 if row.chance else 3
        axis.text(x, y, _short(factor * row.measured), ha="center", va="center", fontsize=5)
    axis.imshow(colours, cmap=ListedColormap(_COLOURS), vmin=-0.5, vmax=3.5, aspect="auto")
    axis.set_xticks(range(len(CHANNELS)), [f"{100 * loss:g}{' b' if bursty else ''}" for loss, bursty in CHANNELS])
    axis.set_yticks(range(len(profiles)), [_LABELS[profile] for _, profile in profiles])
    axis.tick_params(length=0, labelsize=5.5)
    for k, (middleware, name) in enumerate(_NAMES.items()):
        own = [y for y, (of, _) in enumerate(profiles) if of == middleware]
        axis.text(1.01, np.mean(own), name, rotation=270, va="center", fontsize=6, transform=axis.get_yaxis_transform())
        if k:
            axis.axhline(own[0] - 0.5, color="black", lw=0.6)
    axis.grid(False)


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _distributions(
    axis: Axes, channel: tuple[float, bool], quantiles: pd.DataFrame, modelled: Mapping[str, np.ndarray]
) -> None:
    for k, middleware in enumerate(PROFILES):
        case = Case(middleware, "reliable_10", *channel)
        if case.name in quantiles:
            axis.plot(1e3 * quantiles[case.name], LEVELS, color=OKABE_ITO[k], label=_NAMES[middleware])
        if case.name in modelled:
            found = np.quantile(modelled[case.name], LEVELS, method="inverted_cdf")
            axis.plot(1e3 * found, LEVELS, color=OKABE_ITO[k], ls="--")
    loss, bursty = channel
    axis.set(xscale="log", xlim=(8, 3000), ylim=(0, 1.02), xlabel="loop time (ms)", ylabel="share of loops",
             title=f"RELIABLE, 10: {100 * loss:g} % loss{', in bursts' if bursty else ''}")  # fmt: skip
    axis.set_xticks([10, 100, 1000], ["10", "100", "1000"])


def _legend(axis: Axes) -> None:
    axis.axis("off")
    patches = [Patch(fc=colour, ec=GREY, lw=0.4, label=f"model: {meaning}" if k else meaning)
               for k, (colour, meaning) in enumerate(zip(_COLOURS, _MEANINGS, strict=True))]  # fmt: skip
    lines = [Line2D([], [], color=OKABE_ITO[k], label=name) for k, name in enumerate(_NAMES.values())]
    lines += [Line2D([], [], color=GREY, ls=ls, label=label) for ls, label in (("-", "measured"), ("--", "model"))]
    axis.legend(handles=[*patches, *lines], loc="center", frameon=False,
                title="columns: % of the packets lost each way;\nb: in bursts of 200 ms", title_fontsize=7)  # fmt: skip
