"""Tables and plots of the benchmark."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from qocjax.figures.save import save
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, SINGLE_COLUMN, paper_style

__all__ = ["draw_growth", "draw_rates", "draw_times", "markdown", "printed", "write"]

GRID_NAMES = {"on": "multiples of τ", "off": "others"}
COLUMNS = {
    "ns_per_robot_step": "ns per robot-step", "over_cpp": "its time / C++", "over_cpp_metrics": "/ C++, all metrics",
    "vmap_over": "plain vmap / its time",
    "first_call_s": "first call (s)", "best_s": "best call (s)", "mean_auc_s": "mean AUC (s)",
}  # fmt: skip


def printed(table: pd.DataFrame) -> str:
    """The table of times as Markdown."""
    shown = pd.DataFrame({"entry": table["entry"], "cores": table["cores"].map(str)})
    shown["deadlines"] = table["deadlines"].map(GRID_NAMES)
    shown["runs"] = table["runs"].map(str)
    for name, title in COLUMNS.items():
        shown[title] = table[name].map(lambda value: "" if np.isnan(value) else f"{value:.3g}")
    return markdown(shown)


def markdown(table: pd.DataFrame) -> str:
    """A table of strings as Markdown, its columns aligned."""
    rows = [list(table.columns), *table.values.tolist()]
    widths = [max(len(row[k]) for row in rows) for k in range(table.shape[1])]
    lines = ["| " + " | ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True)) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "|".join("-" * (n + 2) for n in widths) + "|", *lines[1:]])


def write(folder: Path, stem: str, table: pd.DataFrame, record: dict[str, Any]) -> None:
    """Writes a table as CSV and, with what it was measured on, as JSON."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / f"{stem}.csv", index=False, float_format="%.5g")
    rows = json.loads(table.to_json(orient="records", double_precision=10))
    text = json.dumps(record | {"rows": rows}, indent=1, ensure_ascii=False)
    (folder / f"{stem}.json").write_text(text + "\n", encoding="utf-8")


def draw_times(table: pd.DataFrame, stem: Path) -> None:
    """Bars of the time per robot-step on a log scale, fastest first; dark where deadlines are multiples of tau."""
    names = table["entry"] + table["one_core"].map({True: ", one core", False: ""})
    times = table.assign(name=names).pivot(index="name", columns="deadlines", values="ns_per_robot_step")
    times = times.sort_values("on", ascending=False)
    with paper_style():
        figure = Figure(figsize=(DOUBLE_COLUMN, 0.5 + 0.27 * len(times)), layout="constrained")
        axes = figure.add_subplot()
        place = np.arange(len(times))
        for grid, shift in (("on", 0.19), ("off", -0.19)):
            colours = [OKABE_ITO[0] if name.startswith("qocjax") else GREY for name in times.index]
            axes.barh(place + shift, times[grid], 0.36, color=colours, alpha=1.0 if grid == "on" else 0.5)
            for y, value in zip(place + shift, times[grid], strict=True):
                axes.annotate(f"{value:.3g}", (value, y), (2, 0), textcoords="offset points", va="center", size=6.5)
        axes.set(xscale="log", xlabel="Time per robot-step (ns)", yticks=place, yticklabels=times.index)
        axes.set_xlim(0.6 * float(times.min(axis=None)), 1.6 * float(times.max(axis=None)))
        axes.spines[["top", "right"]].set_visible(False)
        keys = [Patch(color="black", alpha=a, linewidth=0) for a in (1.0, 0.5)]
        axes.legend(keys, ["deadlines: multiples of τ (one arc a tick)", "others (two)"], loc="upper right")
        save(figure, stem)


def draw_growth(table: pd.DataFrame, stem: Path) -> None:
    """A panel for what each part of the table varies; dashed lines are proportional to it."""
    panels = list(dict.fromkeys(table["panel"]))
    with paper_style():
        figure = Figure(figsize=(DOUBLE_COLUMN, 1.9 * -(-len(panels) // 3)), layout="constrained")
        grid = figure.subplots(-(-len(panels) // 3), min(len(panels), 3), squeeze=False).ravel()
        for axes, panel in zip(grid, panels, strict=False):
            _DRAW.get(panel, _draw_time)(axes, table[table["panel"] == panel], panel)
            axes.spines[["top", "right"]].set_visible(False)
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        save(figure, stem)


def _draw_time(axes: Axes, rows: pd.DataFrame, panel: str) -> None:
    x, y = rows[panel], rows["best_s"]
    axes.plot(x, y, "o-", color=OKABE_ITO[0], markersize=3)
    axes.plot(x, y.iloc[-1] * x / x.iloc[-1], "--", color=GREY, linewidth=0.7)
    axes.set(xscale="log", yscale="log", xlabel=panel.capitalize(), ylabel="Time (s)")
    axes.set_xticks(x, labels=x.map(str))
    axes.minorticks_off()
    axes.set_ylim(10 ** np.floor(np.log10(y.min())), 10 ** np.ceil(np.log10(y.max())))


def _draw_robots(axes: Axes, rows: pd.DataFrame, panel: str) -> None:
    axes.plot(rows[panel], rows["ns_per_pair_tick"], "o-", color=OKABE_ITO[0], markersize=3)
    axes.set_xscale("log", base=2)
    axes.set(xlabel="Robots", ylabel="Time per pair and tick (ns)", xticks=rows[panel], xticklabels=rows[panel])
    axes.set_ylim(bottom=0)


def _draw_memory(axes: Axes, rows: pd.DataFrame, panel: str) -> None:
    runs = rows["designs"] * rows["seeds"]
    for column, colour, marker in (("peak_mib", OKABE_ITO[0], "o"), ("results_mib", OKABE_ITO[1], "s")):
        label = {"peak_mib": "peak", "results_mib": "results"}[column]
        axes.plot(runs, rows[column], f"{marker}-", color=colour, markersize=3, label=label)
    axes.set(xscale="log", xlabel="Runs", ylabel="Memory (MiB)")
    axes.set_ylim(bottom=0)
    axes.legend()


_DRAW = {"robots": _draw_robots, "memory": _draw_memory}


def draw_rates(table: pd.DataFrame, title: str, stem: Path) -> None:
    """Robot-steps per second against the batch size, below the bound of the memory bandwidth."""
    with paper_style():
        figure = Figure(figsize=(SINGLE_COLUMN, 2.4), layout="constrained")
        axes = figure.add_subplot()
        axes.plot(table["runs"], table["robot_steps_per_s"], "o-", color=OKABE_ITO[0], markersize=3, label="measured")
        axes.plot(table["runs"], table["bound_robot_steps_per_s"], "--", color=GREY, label="memory bandwidth")
        axes.set(xscale="log", yscale="log", xlabel="Runs in the batch", ylabel="Robot-steps per second", title=title)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend()
        save(figure, stem)
