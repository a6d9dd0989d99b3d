"""Several studies on one QoC scale: what each policy reaches in each sweep, and how far it is from the first study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure

from qocjax.figures.quantities import parameter
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, POLICIES, paper_style, sequence
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["compared"]

_COLUMNS = ("study", "sweep", "policy", "qoc", "qoc_low", "qoc_high", "difference_low", "difference_high")
_SPREAD = 0.7  # of a row, over which the studies of a sweep are spread
_MARKERS = "osD^v<>P*X"
_WHISKERS: dict[str, Any] = {"ecolor": "k", "elinewidth": 0.7, "capsize": 1.4, "capthick": 0.7}


def compared(table: pd.DataFrame, *, width: float = DOUBLE_COLUMN) -> Figure:
    """Draws QoC with its 95 % interval, and below the differences to the first study with theirs.

    Filled differences are paired; hollow ones are those of independent runs.

    Args:
        table: A row per study, sweep and policy; the first study is what the others are compared with.
        width: Inches.

    Returns:
        The figure, with a column of panels per policy.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(table, "table", ("sweep", "policy", "qoc"), _COLUMNS)
    studies, sweeps = list(dict.fromkeys(table["study"])), list(dict.fromkeys(table["sweep"]))
    policies = [name for name in POLICIES if name in set(table["policy"])]
    colours = OKABE_ITO[: len(studies)] if len(studies) <= len(OKABE_ITO) else sequence(len(studies))
    rows = len(sweeps) * max(1.0, 0.35 * len(studies))
    with paper_style():
        figure = Figure(figsize=(width, 1.3 + 0.36 * rows), layout="constrained")
        panels = np.atleast_2d(figure.subplots(2, len(policies), sharey=True, sharex="row", squeeze=False))
        handles: list[Any] = []
        for place, policy in enumerate(policies):
            part = table[table["policy"] == policy]
            upper, lower = panels[:, place]
            upper.set_title(policy)
            handles = [
                _points(upper, part, name, k, colours[k], len(studies), sweeps) for k, name in enumerate(studies)
            ]
            for k, name in enumerate(studies[1:], start=1):
                _gaps(lower, part, name, k, colours[k], len(studies), sweeps)
            lower.axvline(0.0, color=GREY, lw=0.6, ls="--", zorder=1)
            upper.set_xlabel("QoC")
            lower.set_xlabel(f"difference of QoC to {_short(studies[0])}")
        for panel in panels.flat:
            _rows(panel, sweeps)
        figure.legend(
            handles, [_short(name) for name in studies], loc="outside upper center", ncols=min(4, len(studies))
        )
    return figure


def _points(
    panel: Axes, part: pd.DataFrame, study: str, k: int, colour: Any, count: int, sweeps: list[str]
) -> ErrorbarContainer:
    rows = part[part["study"] == study]
    y = _heights(rows, k, count, sweeps)
    middle = rows["qoc"].to_numpy(float)
    ends = np.clip([middle - rows["qoc_low"], rows["qoc_high"] - middle], 0.0, None)
    return panel.errorbar(middle, y, xerr=ends, fmt=_MARKERS[k % len(_MARKERS)], ms=3.2, color=colour, mec="k", mew=0.4,
                          ls="", **_WHISKERS)  # fmt: skip


def _gaps(panel: Axes, part: pd.DataFrame, study: str, k: int, colour: Any, count: int, sweeps: list[str]) -> None:
    rows = part[(part["study"] == study) & part["difference"].notna()]
    for is_paired, some in rows.groupby("paired"):
        y = _heights(some, k, count, sweeps)
        middle = some["difference"].to_numpy(float)
        ends = np.clip([middle - some["difference_low"], some["difference_high"] - middle], 0.0, None)
        panel.errorbar(middle, y, xerr=ends, fmt=_MARKERS[k % len(_MARKERS)], ms=3.2, color=colour,
                       mfc=colour if is_paired else "w", mec="k" if is_paired else colour,
                       mew=0.4 if is_paired else 0.9, ls="", **_WHISKERS)  # fmt: skip


def _heights(rows: pd.DataFrame, k: int, count: int, sweeps: list[str]) -> np.ndarray:
    """Rows of the sweeps, the studies of each one below the other."""
    offset = _SPREAD * ((k + 0.5) / count - 0.5)
    return np.array([sweeps.index(sweep) for sweep in rows["sweep"]], float) + offset


def _rows(panel: Axes, sweeps: list[str]) -> None:
    panel.set_ylim(len(sweeps) - 0.5, -0.5)
    panel.set_yticks(range(len(sweeps)), labels=[parameter(sweep).symbol for sweep in sweeps])
    panel.tick_params(axis="y", length=0)
    for edge in np.arange(len(sweeps) - 1) + 0.5:
        panel.axhline(edge, color="0.85", lw=0.5, zorder=0)


def _short(name: str) -> str:
    """A name without what Matplotlib would take as mathematics, and not too long."""
    text = name if len(name) <= 28 else f"…{name[-27:]}"
    return text.replace("$", r"\$")
