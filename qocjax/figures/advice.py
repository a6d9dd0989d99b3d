"""The figure of an advice: where the deadline lies, what it gains, and what a worse network takes away."""

from __future__ import annotations

from typing import cast

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from qocjax.figures.quantities import DEADLINE_LABEL, RELIABILITY_LABEL
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style
from qocjax.figures.tables import check_table

__all__ = ["advice_figure"]

_ENDS = ("", "_low", "_high")
_CURVE = ("deadline", "reliability", *(f"{what}_{who}{end}" for what in ("qoc", "collision")
                                       for who in ("recommended", "current") for end in _ENDS))  # fmt: skip
_CLOSE = ("collision_share", "collision_low", "collision_high")
_RECOMMENDED, _CURRENT, _MEAN = OKABE_ITO[0], OKABE_ITO[1], "#8FBFDD"
_GAINS = {"recommended": "recommended", "current": "configured"}
_FEW, _RAREST = 0.1, 1e-4  # missed loops: below which their share is drawn, and down to which


def advice_figure(
    curve: pd.DataFrame,
    judged: pd.DataFrame,
    stress: pd.DataFrame,
    margin: tuple[float, float] | None,
    deadlines: tuple[float, float],
    *,
    width: float = DOUBLE_COLUMN,
    height: float = 3.5,
    limit: float | None = None,
) -> Figure:
    """Draws QoC over the deadline with the margin, and the QoC of what was judged with its 95 % interval.

    Args:
        curve: Over the deadline (s): reliability, and QoC of recommended and current gains with interval ends.
        judged: what, qoc, qoc_low, qoc_high and collision share with its ends of what was compared; the recommended
            design is the last.
        stress: what, qoc, change_low, change_high and collision share with its ends of the recommended design on worse
            networks; the first row is the network as it is, to which the changes are paired.
        margin: Deadlines (s) between which the target and the limit on collisions are kept; None for none.
        deadlines: Recommended and current (s).
        limit: Share of runs with a collision that is allowed.
        width: Inches.
        height: Inches.

    Returns:
        The figure.

    Raises:
        ValueError: A table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(curve, "curve", _CURVE)
    check_table(judged, "judged", ("qoc", "qoc_low", "qoc_high", *_CLOSE))
    check_table(stress, "stress", ("qoc", "change_low", "change_high", *_CLOSE))
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        cast(ConstrainedLayoutEngine, figure.get_layout_engine()).set(wspace=0.06)
        panels = figure.subplot_mosaic([["qoc", "bars"], ["close", "bars"]], width_ratios=[1.25, 1],
                                       height_ratios=[2.4, 1])  # fmt: skip
        left, right = panels["qoc"], panels["bars"]
        _draw_curves(left, curve, margin, deadlines)
        _draw_collisions(panels["close"], left, curve, limit)
        _draw_bars(right, judged, stress, 1.0 if limit is None else limit)
    return figure


def _draw_curves(
    axes: Axes, curve: pd.DataFrame, margin: tuple[float, float] | None, deadlines: tuple[float, float]
) -> None:
    x = 1e3 * curve["deadline"]
    axes.set_xscale("log")
    if margin is not None:
        axes.axvspan(1e3 * margin[0], 1e3 * margin[1], color=_RECOMMENDED, alpha=0.12, lw=0, label="margin")
    for who, colour, at, style in (
        ("recommended", _RECOMMENDED, deadlines[0], "-"),
        ("current", _CURRENT, deadlines[1], "--"),
    ):
        axes.plot(x, curve[f"qoc_{who}"], color=colour, ls=style, lw=1.3, label=f"{_GAINS[who]} gains")
        axes.fill_between(x, curve[f"qoc_{who}_low"], curve[f"qoc_{who}_high"], color=colour, alpha=0.25, lw=0)
        if at > 0:
            axes.axvline(1e3 * at, color=colour, ls=style, lw=0.8)
            place, marker = (0.0, "^") if who == "recommended" else (1.0, "v")  # the two may be close to each other
            axes.plot([1e3 * at], [place], ls="", marker=marker, ms=5, color=colour, clip_on=False, zorder=5,
                      transform=axes.get_xaxis_transform())  # fmt: skip
    _draw_missed(axes, x, curve["reliability"])
    axes.set_xlim(min(x.min(), *(1e3 * at for at in deadlines if at > 0)), max(x.max(), 1e3 * max(deadlines)))
    ratio = x.max() / x.min()
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7) if ratio < 8 else (1, 2, 5) if ratio < 30 else (1, 3)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(DEADLINE_LABEL)
    axes.set_ylabel("QoC")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


def _draw_missed(axes: Axes, x: pd.Series, reliability: pd.Series) -> None:
    """F over the deadline behind the curves; where nearly all loops complete, the share that does not, logarithmic."""
    second, missed = axes.twinx(), 1.0 - reliability
    tail = float(missed.min()) < _FEW
    least = max(float(missed.min()), _RAREST)
    second.plot(x, missed.clip(lower=0.5 * least) if tail else reliability, color=GREY, ls=":", lw=1.2)
    if tail:
        second.set_yscale("log")
        second.set_ylim(0.7 * least, 1.15)
    else:
        second.set_ylim(0.0, 1.04)
    second.set_ylabel(r"Missed loops $1 - F(\Delta)$" if tail else RELIABILITY_LABEL, color=GREY)
    second.tick_params(axis="y", which="both", colors=GREY)
    axes.set_zorder(second.get_zorder() + 1)
    axes.patch.set_visible(False)


def _draw_collisions(axes: Axes, above: Axes, curve: pd.DataFrame, limit: float | None) -> None:
    """Share of runs with a collision over the deadline, on the axis of the QoC above."""
    axes.set_xscale("log")
    for who, colour, style in (("recommended", _RECOMMENDED, "-"), ("current", _CURRENT, "--")):
        axes.plot(1e3 * curve["deadline"], 100 * curve[f"collision_{who}"], color=colour, ls=style, lw=1.3)
        axes.fill_between(1e3 * curve["deadline"], 100 * curve[f"collision_{who}_low"],
                          100 * curve[f"collision_{who}_high"], color=colour, alpha=0.25, lw=0)  # fmt: skip
    if limit is not None:
        axes.axhline(100 * limit, color=GREY, ls=":", lw=1.0)
    axes.set_ylim(-4, 104)
    axes.set_xlim(above.get_xlim())
    axes.xaxis.set_major_locator(above.xaxis.get_major_locator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    above.set_xlabel("")
    above.tick_params(labelbottom=False)
    axes.set_xlabel(DEADLINE_LABEL)
    axes.set_ylabel("Collisions (%)")


def _draw_bars(axes: Axes, judged: pd.DataFrame, stress: pd.DataFrame, limit: float) -> None:
    """QoC of what was compared, and of the recommended design on worse networks, with what collides."""
    base = float(stress["qoc"].iloc[0])
    worse = stress.iloc[1:]
    worse = worse.assign(qoc_low=base + worse["change_low"], qoc_high=base + worse["change_high"])
    rows = pd.concat([judged, worse], ignore_index=True)
    colours = [_CURRENT, _CURRENT, *[_MEAN] * (len(judged) - 3), _RECOMMENDED][-len(judged) :] + ["0.75"] * len(worse)
    for place, (row, colour) in enumerate(zip(rows.itertuples(), colours, strict=True)):
        axes.barh(place, row.qoc, 0.66, color=colour, edgecolor="k", lw=0.5)
        axes.plot([row.qoc_low, row.qoc_high], [place, place], color="k", lw=1.0)
        share = f"{row.collision_share:.{0 if row.collision_share >= 0.1 else 1}%}"
        close = f", {share} collide" if row.collision_share > limit else ""
        axes.annotate(f"{row.qoc:.3f}{close}", (row.qoc_high, place), (3, 0), textcoords="offset points", va="center",
                      fontsize=7)  # fmt: skip
    names = rows["what"].str.replace("current gains", "configured gains").replace("current", "as configured")
    axes.set_yticks(range(len(rows)), labels=names, fontsize=7)
    axes.tick_params(axis="y", length=0)
    axes.axhline(len(judged) - 0.5, color=GREY, lw=0.6)
    axes.invert_yaxis()
    axes.set_xlim(0.0, (1.7 if (rows["collision_share"] > limit).any() else 1.2) * rows["qoc_high"].max())
    axes.set_xlabel("QoC; below the line on worse networks")
