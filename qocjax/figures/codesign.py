"""The joint search as figures: best QoC against simulations spent, and the front of QoC against network demand."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from qocjax.figures.save import save
from qocjax.figures.style import GREY, OKABE_ITO, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import check_table
from qocjax.figures.ticks import label_steps

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["draw_codesign", "qoc_against_demand", "search_curves"]

_CURVE = ("repetition", "simulations", "score", "feasible")
_DEMANDS = {"uplink_kbit_s": "Uplink (kbit/s)", "uplink_blocks": "Uplink (5G PRBs)"}
_FRONT = ("tau", "loops_per_s", *_DEMANDS, "score", "score_low", "score_high", "feasible", "within_limit", "front")
_WORKERS = {"workers": "Workers busy in the mean", "edge_workers": "Workers of the edge"}
_NAMES = {
    "random": "random",
    "sobol": "Sobol, halving",
    "cma_es": "CMA-ES",
    "sobol_gradient": "Sobol, then gradient",
    "cma_gradient": "CMA-ES, then gradient",
}
_MARKERS = "osD^v<"
_LABELS = {"mean": "QoC", "cvar": "CVaR of QoC"}


def search_curves(
    curve: pd.DataFrame, policies: pd.DataFrame | None = None, *, measure: str = "mean", width: float = SINGLE_COLUMN,
    height: float = 2.9,
) -> Figure:  # fmt: skip
    """Draws the score of the best design known (fresh seeds) against simulations spent, one line per method.

    Lines are the median over repetitions, bands their whole range. Designs that break the limits on fresh seeds have
    no point. The grey line is the best one-at-a-time design of the policies, marked at the simulations that their
    sweeps took.

    Args:
        curve: One row per method, repetition and count of simulations.
        policies: Best one-at-a-time design of each policy; none is drawn where empty or None.
        measure: `mean` or `cvar`, for the axis.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(curve, "curve", _CURVE)
    if "method" not in curve.columns:
        raise ValueError(f"curve: column 'method' is missing; got {', '.join(map(str, curve.columns))}")
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        for place, method in enumerate(dict.fromkeys(curve["method"])):
            _draw_method(axes, curve[curve["method"] == method], place, _NAMES.get(method, method))
        if policies is not None and not policies.empty:
            check_table(policies, "policies", ("policy", "score", "simulations"))
            best = policies.loc[policies["score"].idxmax()]
            axes.axhline(best["score"], color=GREY, ls="--", lw=0.9, zorder=1)
            axes.plot([best["simulations"]], [best["score"]], color=GREY, ls="--", lw=0.9, marker="x", ms=5, zorder=4,
                      label=f"best one at a time ({best['policy']})")  # fmt: skip
        _fit_scores(axes, curve, policies)
        axes.set_xscale("log")
        counts = [curve["simulations"], *([] if policies is None or policies.empty else [policies["simulations"]])]
        _label_counts(axes, np.concatenate(counts).astype(float))
        axes.set_xlabel("Simulations spent")
        axes.set_ylabel(f"{_LABELS.get(measure, measure)} of the best design known")
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def _draw_method(axes: Axes, rows: pd.DataFrame, place: int, label: str) -> None:
    """Median and range over repetitions at common counts; between its looks a search keeps what it knew."""
    kept = rows[rows["feasible"].astype(bool)]
    if kept.empty:
        axes.plot([], [], color=OKABE_ITO[place % 6], label=f"{label}: none feasible")
        return
    counts = np.unique(kept["simulations"])
    lines = []
    for _, one in kept.sort_values("simulations").groupby("repetition"):
        last = np.searchsorted(one["simulations"], counts, side="right") - 1
        lines.append(np.where(last >= 0, one["score"].to_numpy(float)[np.maximum(last, 0)], np.nan))
    table = np.array(lines)
    whole = np.isfinite(table).all(axis=0)  # from where every repetition has a feasible design
    counts, table = counts[whole], table[:, whole]
    colour, marker = OKABE_ITO[place % len(OKABE_ITO)], _MARKERS[place % len(_MARKERS)]
    axes.plot(counts, np.median(table, axis=0), color=colour, marker=marker, ms=2.5, label=label, zorder=3)
    axes.fill_between(counts, table.min(axis=0), table.max(axis=0), color=colour, alpha=0.12, lw=0, zorder=2)


def _fit_scores(axes: Axes, curve: pd.DataFrame, policies: pd.DataFrame | None) -> None:
    """Fits the axis to where searches end and policies lie; how badly a search began may leave it."""
    last = curve.sort_values("simulations").groupby(["method", "repetition"])["score"].last()
    shown = [*last, *([] if policies is None or policies.empty else [policies["score"].max()])]
    reach = max(max(shown) - min(shown), 0.02)
    axes.set_ylim(min(shown) - 0.75 * reach, max(shown) + 0.1 * reach)


def _label_counts(axes: Axes, counts: np.ndarray) -> None:
    steps = np.outer(10.0 ** np.arange(0, 9), [1, 2, 5]).ravel()
    axes.xaxis.set_major_locator(FixedLocator(list(steps[(steps >= counts.min()) & (steps <= 1.05 * counts.max())])))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def qoc_against_demand(
    front: pd.DataFrame,
    against: str = "loops_per_s",
    *,
    measure: str = "mean",
    width: float = SINGLE_COLUMN,
    height: float = 3.2,
) -> Figure:
    """Draws the best design of each sampling period, or number of workers: score against what it asks.

    What a message asks of the network is proportional to loops per second; above are the uplink's rate and its mean
    number of 5G resource blocks. Workers are not, and have an axis of their own.

    Filled points are on the front, open ones are beaten by a design that asks for less. Crosses break the limits, and
    vertical ones keep them, but not by the upper end of the share of runs with a collision: they are on no front.

    Args:
        front: One row per sampling period, or number of workers.
        against: `loops_per_s`, `workers` (busy in the mean) or `edge_workers` (that there are).
        measure: `mean` or `cvar`, for the axis.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(front, "front", (*_FRONT, against))
    rows = front.sort_values(against)
    feasible, kept = rows["feasible"].astype(bool), rows["within_limit"].astype(bool)
    with paper_style():
        figure = Figure(figsize=(width, height))
        axes = figure.add_axes((0.155, 0.27, 0.815, 0.455))  # by hand: no layout knows of the axes far above
        best = rows[rows["front"].astype(bool)]
        axes.step(best[against], best["score"], where="post", color=OKABE_ITO[0], lw=0.8, zorder=2)
        for part, fill, marker, label in (
            (best, OKABE_ITO[0], "o", "on the front"),
            (rows[kept & ~rows["front"].astype(bool)], "w", "o", "beaten by less demand"),
            (rows[feasible & ~kept], "w", "+", "safety not shown"),
            (rows[~feasible], "w", "x", "breaks the limits"),
        ):
            if not part.empty:
                reach = np.abs(part[["score_low", "score_high"]].to_numpy(float).T - part["score"].to_numpy(float))
                axes.errorbar(part[against], part["score"], reach, ls="", color=OKABE_ITO[0], ms=4, capsize=1.6,
                              elinewidth=0.7, label=label, zorder=3, mfc=fill, marker=marker)  # fmt: skip
        for row in rows.itertuples():
            place = (getattr(row, against), row.score_low)
            text = axes.annotate(f"{1e3 * row.tau:g}", place, (0, -3), ha="center", va="top", fontsize=6.5, color=GREY,
                                 textcoords="offset points")  # fmt: skip
            text.set_path_effects([Stroke(linewidth=2.0, foreground="w"), Normal()])
        if against == "loops_per_s":
            _label_demand(axes, rows)
        else:
            axes.set_xscale("log")
            label_steps(axes.xaxis, *_about(rows[against]))
            axes.set_xlabel(_WORKERS[against])
        axes.set_ylabel(_LABELS.get(measure, measure))
        axes.margins(x=0.08, y=0.2)
        figure.legend(loc="lower center", ncols=2, title=r"best design of each, $\tau$ in ms at the points")
    return figure


def _label_demand(axes: Axes, rows: pd.DataFrame) -> None:
    """Loops per second below, uplink kbit/s and resource blocks above, all logarithmic."""
    axes.set_xscale("log")
    label_steps(axes.xaxis, *_about(rows["loops_per_s"]))
    axes.set_xlabel("Loops per second, all robots")
    for place, (name, label) in enumerate(_DEMANDS.items()):
        ratio = float((rows[name] / rows["loops_per_s"]).iloc[0])
        functions = (partial(np.multiply, ratio), partial(np.multiply, 1 / ratio))
        above = axes.secondary_xaxis(1.0 + 0.28 * place, functions=functions)
        label_steps(above.xaxis, *_about(rows[name]))
        above.set_xlabel(label)


def _about(values: pd.Series) -> tuple[float, float]:
    return float(values.min()) / 1.3, 1.3 * float(values.max())


def draw_codesign(
    curve: pd.DataFrame,
    policies: pd.DataFrame,
    front: pd.DataFrame | None,
    folder: Path,
    *,
    measure: str = "mean",
    against: str = "loops_per_s",
    workers: pd.DataFrame | None = None,
) -> list[Path]:
    """Draws the search, and the fronts that there are.

    Args:
        curve: Best design known against simulations spent.
        policies: The policies' best designs.
        front: Best design of each sampling period, or None.
        folder: Where the files go.
        measure: `mean` or `cvar`.
        against: What the front is one against.
        workers: Best design for each number of workers, or None.

    Returns:
        The files, a PNG and a PDF of each figure.
    """
    paths = save(search_curves(curve, policies, measure=measure), folder / "search")
    if front is not None:
        axis = against if against in _WORKERS else "loops_per_s"
        paths += save(qoc_against_demand(front, axis, measure=measure), folder / "front")
    if workers is not None:
        paths += save(qoc_against_demand(workers, "edge_workers", measure=measure), folder / "workers")
    return paths
