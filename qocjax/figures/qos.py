"""Figures of the QoS study: QoC with throughput, delays with misses, and the map of where RELIABLE wins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from qocjax.figures.quantities import DEADLINE_LABEL
from qocjax.figures.style import DOUBLE_COLUMN, OKABE_ITO, paper_style
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["delay_figure", "qoc_figure", "win_map"]

_EVEN = 0.01  # difference of QoC up to which colours are even
_LINES = ("-", "--", "-", "-.", ":")
_RAREST = 1e-3  # share of loops down to which tails are drawn
_QUANTILES = ((0.5, "o"), (0.95, "s"), (0.99, "^"))


def _check(table: pd.DataFrame, name: str, numbers: tuple[str, ...]) -> None:
    """Checks that a table has rows by profile, loss and burst, and the numbers."""
    check_table(table, name, ("loss", "burst", *numbers))
    if "profile" not in table.columns:
        raise ValueError(f"{name}: column 'profile' is missing; got {', '.join(map(str, table.columns))}")


def _at(table: pd.DataFrame, loss: float, burst: float) -> pd.DataFrame:
    rows = table[(table["loss"] == loss) & (table["burst"] == burst)]
    if rows.empty:
        raise ValueError(f"table: got no row of loss {loss:g} and burst {burst:g}, expected one per profile")
    return rows.reset_index(drop=True)


def qoc_figure(
    best: pd.DataFrame, transport: pd.DataFrame, loss: float, burst: float, *, width: float = DOUBLE_COLUMN,
    height: float = 2.2,
) -> Figure:  # fmt: skip
    """Draws QoC and throughput of each profile on one channel (the paper's "QoC variation and throughput").

    Args:
        best: profile, loss, burst, qoc, qoc_low, qoc_high: each profile at its best deadline.
        transport: profile, loss, burst, kbit_s, kbit_s_sd.
        loss: Of the channel.
        burst: Of the channel.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: A table lacks a column or the channel.
    """
    _check(best, "best", ("qoc", "qoc_low", "qoc_high"))
    _check(transport, "transport", ("kbit_s", "kbit_s_sd"))
    scores, sent = _at(best, loss, burst), _at(transport, loss, burst)
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        _bars(left, scores["profile"], scores["qoc"], scores["qoc_high"] - scores["qoc"], "{:.3f}")
        left.set_xlabel("QoC at the best deadline, 95 % interval")
        _bars(right, sent["profile"], sent["kbit_s"], sent["kbit_s_sd"], "{:.0f}")
        right.set_xlabel("Throughput (kbit/s), standard deviation over seconds")
        left.invert_yaxis()
    return figure


def _bars(axes: Axes, names: pd.Series, values: pd.Series, errors: pd.Series, form: str) -> None:
    for place, (value, error) in enumerate(zip(values, errors, strict=True)):
        axes.barh(place, value, 0.66, color=OKABE_ITO[place % len(OKABE_ITO)], edgecolor="k", lw=0.5)
        axes.plot([value - error, value + error], [place, place], color="k", lw=1.0)
        axes.annotate(form.format(value), (value + error, place), (3, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(names)), labels=list(names))
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0.0, 1.18 * float((values + errors).max()))


def delay_figure(
    loop_times: Mapping[str, np.ndarray], transport: pd.DataFrame, results: pd.DataFrame, best: pd.DataFrame,
    loss: float, burst: float, *, width: float = DOUBLE_COLUMN, height: float = 2.4,
) -> Figure:  # fmt: skip
    """Draws the share of loops that take longer than a time, with percentiles, and losses and deadline misses.

    That share has a logarithmic axis: tails are what deadlines cut. Marks are the 50th, 95th and 99th percentile of
    the loops that arrive.

    Args:
        loop_times: T_net (s) by profile, any shape, inf where lost.
        transport: profile, loss, burst, lost, p50, p95, p99.
        results: profile, loss, burst, deadline, miss_share.
        best: profile, loss, burst, deadline: of the shortest of these deadlines a line is drawn.
        loss: Of the channel.
        burst: Of the channel.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: A table lacks a column or the channel.
    """
    _check(transport, "transport", ("lost",))
    _check(results, "results", ("deadline", "miss_share"))
    _check(best, "best", ("deadline",))
    sent, rows, chosen = _at(transport, loss, burst), _at(results, loss, burst), _at(best, loss, burst)
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        left, right = figure.subplots(1, 2)
        lines: list[Line2D] = []
        for k, (name, times) in enumerate(loop_times.items()):
            lines.append(_distribution(left, name, np.ravel(times), sent[sent["profile"] == name].iloc[0], k))
            own = rows[rows["profile"] == name]
            right.plot(1e3 * own["deadline"], 100 * own["miss_share"], color=_colour(k), ls=_line(k), marker=".", ms=4)
            picked = chosen[chosen["profile"] == name].iloc[0]["deadline"]
            miss = own.loc[np.isclose(own["deadline"], picked), "miss_share"]
            right.plot([1e3 * picked], 100 * miss, ls="", marker="*", ms=8, color=_colour(k), mec="k", mew=0.5)
        spread = [row[q] for _, row in sent.iterrows() for q in ("p50", "p99") if np.isfinite(row[q])]
        if spread:
            room = 0.35 * (max(spread) - min(spread)) + 1e-3
            left.set_xlim(1e3 * max(min(spread) - room, 0.0), 1e3 * (max(spread) + room))
        left.set_xlabel(r"Loop time $T_\mathrm{net}$ (ms)")
        left.legend(handles=_marks(), title="of those that arrive", loc="lower left")
        left.set_ylabel("Share of loops that take longer")
        left.set_yscale("log")
        left.set_ylim(_RAREST, 1.15)
        right.set_xlabel(DEADLINE_LABEL + r"; $\star$ best QoC")
        right.set_ylabel("Loops that miss it (%)")
        right.set_ylim(bottom=0.0)
        figure.legend(handles=lines, loc="outside upper center", ncols=len(loop_times))
    return figure


def _colour(k: int) -> str:
    return OKABE_ITO[k % len(OKABE_ITO)]


def _line(k: int) -> str:
    return _LINES[k % len(_LINES)]


def _distribution(axes: Axes, name: str, times: np.ndarray, row: pd.Series, k: int) -> Line2D:
    arrived = times[np.isfinite(times)]
    line = Line2D([], [], color=_colour(k), ls=_line(k), label=name)
    if arrived.size:
        levels, share = 1.0 - np.geomspace(1.0, _RAREST, 400), arrived.size / times.size
        axes.plot(1e3 * np.quantile(arrived, levels), 1.0 - share * levels, color=_colour(k), ls=_line(k))
        for (level, marker), q in zip(_QUANTILES, ("p50", "p95", "p99"), strict=True):
            axes.plot(
                [1e3 * row[q]], [1.0 - share * level], ls="", marker=marker, ms=4, mfc="w", mec=_colour(k), zorder=3
            )
    return line


def _marks() -> list[Line2D]:
    return [Line2D([], [], ls="", ms=4, mfc="w", mec="k", marker=m, label=f"{level:.0%}") for level, m in _QUANTILES]


def win_map(
    results: pd.DataFrame, baseline: str, *, width: float = DOUBLE_COLUMN, height: float | None = None
) -> Figure:
    """Draws the difference of QoC to the baseline profile over deadline and loss, a panel for each profile and burst.

    A sign marks cells whose difference is told from 0, all of the map together at 95 %: a deadline may be picked from
    it. Colours are even up to ±0.01, logarithmic beyond.

    Args:
        results: profile, burst, loss, deadline, difference, difference_told (of `QosStudy`).
        baseline: Name of the profile that the others are compared with.
        width: Inches.
        height: Inches; by default by the number of panels.

    Raises:
        ValueError: The table lacks a column or is empty.
    """
    _check(results, "results", ("deadline", "difference", "difference_told"))
    profiles, bursts = list(dict.fromkeys(results["profile"])), sorted(set(results["burst"]))
    largest = max(float(results["difference"].abs().max()), 2 * _EVEN)
    with paper_style():
        figure = Figure(figsize=(width, height or 0.5 + 1.35 * len(bursts)), layout="constrained")
        panels = figure.subplots(len(bursts), len(profiles), sharex=True, sharey=True, squeeze=False)
        for line, burst in zip(panels, bursts, strict=True):
            for axes, profile in zip(line, profiles, strict=True):
                rows = results[(results["profile"] == profile) & (results["burst"] == burst)]
                mesh = _panel(axes, rows, largest)
            line[0].set_ylabel(("independent" if burst == 1 else f"bursts of {burst:g}") + "\nmessages lost")
        for axes, profile in zip(panels[0], profiles, strict=True):
            axes.set_title(profile)
        figure.supxlabel(DEADLINE_LABEL, fontsize=8)
        bar = figure.colorbar(mesh, ax=panels, label=f"QoC less that of {baseline}", pad=0.01, aspect=25)
        bar.set_ticks(_ticks(largest), labels=[f"{value:+g}" if value else "0" for value in _ticks(largest)])
        bar.minorticks_off()
        bar.outline.set_linewidth(0.6)
    return figure


def _panel(axes: Axes, rows: pd.DataFrame, largest: float) -> QuadMesh:
    names = ("difference", "difference_told")
    grid, told = (rows.pivot(index="loss", columns="deadline", values=name) for name in names)
    scale = SymLogNorm(_EVEN, vmin=-largest, vmax=largest)
    mesh = axes.pcolormesh(grid.to_numpy(), cmap="RdBu", norm=scale, rasterized=True)
    for y, x in zip(*np.nonzero(told.to_numpy()), strict=True):
        light, sign = abs(grid.iat[y, x]) > 0.3 * largest, "+" if told.iat[y, x] > 0 else "−"
        axes.text(x + 0.5, y + 0.48, sign, ha="center", va="center", fontsize=7, color="w" if light else "k")
    axes.set_xticks(np.arange(grid.shape[1]) + 0.5, labels=[f"{1e3 * d:g}" for d in grid.columns], rotation=90)
    axes.set_yticks(np.arange(grid.shape[0]) + 0.5, labels=[f"{100 * p:g} %" for p in grid.index])
    axes.tick_params(length=0)
    return mesh


def _ticks(largest: float) -> list[float]:
    """Numbers of a colour bar that is even around 0 and logarithmic beyond."""
    known = [value for value in (_EVEN, 0.05, 0.2, 0.5) if value <= largest]
    return [*(-value for value in reversed(known)), 0.0, *known]
