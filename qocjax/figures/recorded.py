"""Figures of a recorded run: its paths, its delays, and how its clocks were put together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from qocjax.figures.save import save
from qocjax.figures.style import GREY, OKABE_ITO, SINGLE_COLUMN, paper_style
from qocjax.figures.ticks import label_steps
from qocjax.figures.trajectories import trajectories
from qocjax.recorded.judge import Quality
from qocjax.recorded.loops import LoopTrace
from qocjax.recorded.run import RecordedRun

__all__ = ["clock_figure", "delay_figure", "draw_recorded"]

_PARTS = {
    "loop_time": ("loop $T_\\mathrm{net}$", "-"), "uplink": ("uplink $T_\\mathrm{UL}$", "--"),
    "compute": ("compute $T_\\mathrm{C}$", ":"), "downlink": ("downlink $T_\\mathrm{DL}$", "-."),
}  # fmt: skip
_MOST_POINTS = 4000  # drawn of a path or a clock
_STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 60.0, 600.0, np.inf)  # s, between points of a path
_MOST_CLOCKS = 20  # drawn of one trace


def draw_recorded(run: RecordedRun, folder: Path) -> list[Path]:
    """Draws what a run has: paths, the delays of all its traces, and the clocks of each that has up to 20."""
    written = []
    if run.quality is not None:
        for name, view in _views(run.quality).items():
            written += save(trajectories(view), folder / f"trajectories{name}")
    if run.loops:
        written += save(delay_figure(run.loops), folder / "delays")
    for robot, trace in run.loops.items():
        if 0 < len(trace.clocks) <= _MOST_CLOCKS:
            written += save(clock_figure(trace), folder / f"clock_{robot}")
    return written


def _views(quality: Quality) -> dict[str, Quality]:
    """The robots with an AUC at even times, for drawing; one by one where they share no frame."""
    step = next(step for step in _STEPS if quality.duration <= step * _MOST_POINTS)
    time = np.append(step * np.arange(int(quality.duration / step)), quality.duration)

    def at(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(values.shape[0], -1)
        found = [np.interp(time, quality.time, column) for column in flat.T]
        return np.stack(found, axis=1).reshape(-1, *values.shape[1:])

    defined = np.flatnonzero(np.isfinite(quality.auc))
    if not defined.size:
        return {}
    pose, reference = at(quality.pose)[:, defined], at(quality.reference)
    thin = replace(
        quality, robots=tuple(quality.robots[k] for k in defined), time=time, pose=pose, auc=quality.auc[defined],
        reference=reference[:, defined] if reference.ndim == 3 else reference,
        goal=quality.goal[defined] if np.ndim(quality.goal) == 2 else quality.goal,
        min_distance=np.inf if defined.size == 1 else quality.min_distance,
    )  # fmt: skip
    if not np.isnan(quality.min_distance):
        return {"": thin}
    return {
        f"_{robot}": replace(
            thin, robots=(robot,), pose=thin.pose[:, k : k + 1], auc=thin.auc[k : k + 1], min_distance=np.inf,
            goal=np.reshape(thin.goal, (-1, 2))[k if np.ndim(thin.goal) == 2 else 0],
            reference=thin.reference[:, k] if thin.reference.ndim == 3 else thin.reference,
        )
        for k, robot in enumerate(thin.robots)
    }  # fmt: skip


def delay_figure(loops: dict[str, LoopTrace], *, width: float = SINGLE_COLUMN) -> Figure:
    """Draws the share of loops, and of their parts, that take longer than a time: the complementary distribution.

    Both axes are logarithmic, so that one late loop in a thousand is seen; lost loops keep a curve above their share.

    Args:
        loops: Traces by robot; at most six are told apart by colour.
        width: Inches.
    """
    with paper_style():
        figure = Figure(figsize=(width, 0.75 * width), layout="constrained")
        axes = figure.add_subplot()
        smallest, largest, rarest = np.inf, 0.0, 1.0
        for k, (robot, trace) in enumerate(loops.items()):
            for column, (label, style) in _PARTS.items():
                values = trace.table[column].dropna().to_numpy()
                ordered = 1e3 * np.sort(values[np.isfinite(values)])
                if not ordered.size:
                    continue
                colour = OKABE_ITO[(list(_PARTS).index(column) if len(loops) == 1 else k) % len(OKABE_ITO)]
                name = label if len(loops) == 1 else f"{robot}: {label}"
                count = len(trace.table) if column == "loop_time" else ordered.size
                later = 1.0 - np.arange(1, ordered.size + 1) / count
                axes.step(ordered, np.where(later > 1e-12, later, np.nan), style, where="post", color=colour,
                          label=name, lw=1.1)  # fmt: skip
                smallest, largest = min(smallest, np.percentile(ordered, 0.5)), max(largest, ordered[-1])
                rarest = min(rarest, 1.0 / count)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(max(smallest, 1e-3), largest)
        axes.set_ylim(0.7 * rarest, 1.15)
        axes.set_xlabel("Delay (ms)")
        axes.set_ylabel("Share of loops that take longer")
        label_steps(axes.xaxis, max(smallest, 1e-3), largest)
        figure.legend(loc="outside upper center", ncols=2)
    return figure


@dataclass(frozen=True)
class _Direction:
    column: str
    label: str
    sign: float
    colour: str


def clock_figure(trace: LoopTrace, *, width: float = SINGLE_COLUMN) -> Figure:
    """Draws the apparent delays of both directions over time, and the estimated offset of the edge's clock.

    The axis reaches from the smallest apparent delays to the usual ones: what is later says nothing of the clock.
    """
    ways = (_Direction("uplink", "uplink as stamped", 1.0, OKABE_ITO[0]),
            _Direction("downlink", "downlink as stamped", -1.0, OKABE_ITO[1]))  # fmt: skip
    with paper_style():
        figure = Figure(figsize=(width, 0.75 * width), layout="constrained")
        axes = figure.add_subplot()
        seen = trace.apparent.dropna()
        seen = seen.iloc[:: max(1, len(seen) // _MOST_POINTS)]
        for way in ways:
            axes.plot(seen["source_stamp"], 1e3 * way.sign * seen[way.column], ".", ms=1.2, alpha=0.5, color=way.colour,
                      mec="none", label=way.label if way.sign > 0 else f"$-$ {way.label}", rasterized=True)  # fmt: skip
        for k, clock in enumerate(trace.clocks):
            axes.plot(clock.knots, 1e3 * clock.offsets, color="k", lw=1.2,
                      label="offset of the edge's clock" if k == 0 else None)  # fmt: skip
        low = 1e3 * float(np.percentile(-seen["downlink"], 5))
        high = 1e3 * float(np.percentile(seen["uplink"], 95))
        margin = 0.3 * max(high - low, 0.1)
        axes.set_ylim(low - margin, high + margin)
        axes.set_xlabel("Time (s)")
        axes.set_ylabel("Edge's clock less robot's (ms)")
        axes.axhline(0.0, color=GREY, lw=0.5, zorder=0)
        figure.legend(loc="outside upper center", ncols=2, markerscale=5)
    return figure
