"""Charts of what fleets need: maps over robots and what they are given, and the gain of one step of each kind."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.fleets.tables import FleetStudy
from qocjax.report.charts import axis, colour_scale, layout
from qocjax.report.fleet_charts import TEXT, state_text
from qocjax.report.html import escape, interval, signed

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["GIVEN", "map_chart", "steps_chart"]

GIVEN = {"prbs": "Resource blocks (PRBs)", "workers": "Workers"}


def map_chart(study: FleetStudy, given: str) -> dict[str, Any]:
    """QoC of each fleet and amount in cells of equal size; the contour of the target."""
    table = study.maps[given].sort_values([given, "robots"])
    score = table.pivot(index=given, columns="robots", values="qoc")
    rows, columns = score.shape
    what = GIVEN.get(given, given).split(" (")[0].lower()
    texts = [
        [f"{row['robots']} robots with {row[given]} {what}: {state_text(row)}"] for row in table.to_dict("records")
    ]
    cells = [texts[k * columns : (k + 1) * columns] for k in range(rows)]
    heat = {
        "type": "heatmap", "x": list(range(columns)), "y": list(range(rows)), "z": score.to_numpy(float),
        "customdata": cells, "colorscale": colour_scale(), "zmin": 0.0, "zmax": 1.0, "xgap": 1, "ygap": 1,
        "colorbar": {"title": {"text": "QoC", "side": "right"}, "thickness": 12, "outlinewidth": 0, "len": 1,
                     "ticks": "outside", "ticklen": 3},
        "hovertemplate": "%{customdata[0]}<extra></extra>",
    }  # fmt: skip
    target = study.asked.qoc
    line = {"type": "contour", "x": heat["x"], "y": heat["y"], "z": heat["z"], "autocontour": False, "showscale": False,
            "contours": {"start": target, "end": target, "size": 1, "coloring": "none"}, "hoverinfo": "skip",
            "line": {"width": 2.5, "color": "#ffffff", "smoothing": 0}}  # fmt: skip
    close = np.flatnonzero(study.asked.too_close(table))
    crosses = {"type": "scatter", "mode": "markers", "x": (close % columns).tolist(),
               "y": (close // columns).tolist(), "hoverinfo": "skip",
               "marker": {"symbol": "x-thin", "size": 16, "line": {"width": 2.5, "color": "#D55E00"}}}  # fmt: skip
    across = axis("Robots N", tickvals=heat["x"], ticktext=[str(n) for n in score.columns], ticks="",
                  range=[-0.5, columns - 0.5])  # fmt: skip
    up = axis(GIVEN.get(given, given), tickvals=heat["y"], ticktext=[str(n) for n in score.index], ticks="",
              range=[-0.5, rows - 0.5])  # fmt: skip
    return {"data": [heat, line, crosses] if min(rows, columns) > 1 else [heat, crosses],
            "layout": layout(xaxis=across, yaxis=up, margin={"l": 62, "r": 10, "t": 14, "b": 48}),
            "grid": [heat["x"], heat["y"]]}  # fmt: skip


def steps_chart(steps: pd.DataFrame) -> dict[str, Any]:
    """Gain of each step with its interval, the largest on top."""
    kinds = {"nfs": steps["gain_told"] > 0, "nfx": steps["gain_told"] < 0}
    kinds["nft"] = ~(kinds["nfs"] | kinds["nfx"])
    traces = []
    for uid, chosen in kinds.items():
        rows = steps[chosen]
        texts = [f"{escape(row['step'])}: {signed(row['gain'])} {interval(row['gain_low'], row['gain_high'])}<br>"
                 f"{state_text(row)}" for row in rows.to_dict("records")]  # fmt: skip
        gain = rows["gain"].to_numpy()
        traces.append({
            "type": "scatter", "mode": "markers", "uid": uid, "x": gain, "y": rows.index.to_numpy(),
            "error_x": {"type": "data", "symmetric": False, "array": rows["gain_high"].to_numpy() - gain,
                        "arrayminus": gain - rows["gain_low"].to_numpy(), "thickness": 1.3, "width": 3},
            "marker": {"size": 10}, "customdata": texts, "hovertemplate": TEXT,
        })  # fmt: skip
    up = axis("", tickvals=list(range(len(steps))), ticktext=[escape(step) for step in steps["step"]], ticks="",
              range=[len(steps) - 0.4, -0.6])  # fmt: skip
    return {"data": traces, "height": 100 + 30 * len(steps), "layout": layout(
        xaxis=axis("Gain in QoC", zeroline=True), yaxis=up, hovermode="closest",
        margin={"l": 120, "r": 14, "t": 14, "b": 48},
    )}  # fmt: skip
