"""The page of several studies on one QoC scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.figures.style import OKABE_ITO, sequence
from qocjax.report.charts import axis, colour_style, layout, legend_item
from qocjax.report.html import escape, interval, number, percent, plus_minus, signed
from qocjax.report.labels import DEADLINE, choice_words, name_of, symbol, value_cell
from qocjax.report.page import Section, facts, render, write
from qocjax.report.parts import chart_place, tabs
from qocjax.report.policies import mark
from qocjax.study.comparison import Comparison
from qocjax.study.reliability import share_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["write_comparison_report"]

_SHAPES = ("circle", "square", "diamond", "triangle-up", "triangle-down", "cross", "star")
_HEADS = ("Sweep", "Policy", "Study", "Value", "Δ&nbsp;(ms)", "QoC ± SE", "On its own scale", "Difference [95 %]",
          "AUC ± SE (s)", "Runs too close")  # fmt: skip


def write_comparison_report(path: Path, found: Comparison, folders: Mapping[str, str]) -> Path:
    """Writes a comparison as one HTML file that needs nothing else.

    Args:
        path: Where it goes.
        found: What was found.
        folders: Of the studies, by name.

    Returns:
        The file.
    """
    table, studies = found.table, list(folders)
    sweeps = list(dict.fromkeys(table["sweep"]))
    uids = {name: f"n{len(studies):02d}s{k:02d}" for k, name in enumerate(studies)}
    colours = list(OKABE_ITO[: len(studies)]) if len(studies) <= len(OKABE_ITO) else sequence(len(studies))
    charts: dict[str, Any] = {"differences": _difference_chart(table, studies, uids)}
    for sweep in sweeps:
        charts[f"curve-{sweep}"] = _curve_chart(found.curves[found.curves["sweep"] == sweep], sweep, uids)
    legend = f'<div class="legend" role="group" aria-label="Studies">{_legend(studies, uids)}</div>'
    style = "".join(colour_style(uids[name], colour) for name, colour in zip(studies, colours, strict=True))
    notes = "".join(f'<p class="notice">{escape(note)}</p>' for note in found.notes)
    scale = found.scale
    lead = f"<style>{style}</style>{_headline(table, studies)}{notes}" + facts(
        {"J_med, J_max of all runs": f"{number(scale.median)} s, {number(scale.largest)} s"}
        | {f"Study {k}": f"{escape(name)}" for k, name in enumerate(studies, start=1)}
    )
    sections = [
        Section("differences", "Differences", _differences(studies[0], legend)),
        Section("policies", "Policies", _table(table, studies)),
        Section("deadlines", "Deadlines", _curves(sweeps, legend)),
        Section("folders", "Folders", facts({name: f"<code>{escape(each)}</code>" for name, each in folders.items()})),
    ]
    page = render(" against ".join(studies), "Studies on one QoC scale", lead, sections, {"charts": charts}, _FOOTER)
    return write(path, page)


_FOOTER = (
    "<p>QoC is 1 / (1 + min(<i>J</i><sub>max</sub>, <i>J</i>) / <i>J</i><sub>med</sub>) with <i>J</i><sub>med</sub> "
    "and <i>J</i><sub>max</sub> of all runs of all studies here, so it differs from that in each study's own report. "
    "Policies keep the designs that they chose there. Written by qocjax.</p>"
)


def _headline(table: pd.DataFrame, studies: Sequence[str]) -> str:
    """How the best joint choices compare."""
    joint = table[table["policy"] == "Co-design"]
    texts = []
    for name in studies:
        rows = joint[joint["study"] == name]
        if len(rows):
            best = rows.loc[rows["qoc"].idxmax()]
            texts.append(
                f"{escape(name)} <strong>{plus_minus(best['qoc'], best['qoc_se'])}</strong> "
                f"({choice_words(best)}, Δ = "
                f"{number(1e3 * best['deadline'])} ms)"
            )
    return f'<p class="headline">QoC of the best joint choice: {"; ".join(texts)}.</p>' if texts else ""


def _differences(first: str, legend: str) -> str:
    return (
        f"<p>QoC of each policy in each sweep, minus that in {escape(first)}, with the 95 % interval. Filled marks are "
        "paired: both studies saw the same starts and loop times. Hollow ones are not.</p>"
        f"{chart_place('differences', 'Difference of QoC', after=legend)}"
    )


def _curves(sweeps: Sequence[str], legend: str) -> str:
    panels = {
        sweep: chart_place(
            f"curve-{sweep}", f"QoC over the deadline at the best {name_of(sweep).lower()}", after=legend
        )
        for sweep in sweeps
    }
    return (
        "<p>The best value at each deadline, on the seeds of the choice, with one standard error; the best of many "
        f"noisy scores flatters itself a little.</p>{tabs(panels)}"
    )


def _legend(studies: Sequence[str], uids: Mapping[str, str]) -> str:
    return "".join(legend_item(uids[name], escape(name)) for name in studies)


def _difference_chart(table: pd.DataFrame, studies: Sequence[str], uids: Mapping[str, str]) -> dict[str, Any]:
    """A row per sweep and policy, the studies of each one below the other."""
    keys = list(dict.fromkeys(zip(table["sweep"], table["policy"], strict=True)))
    others, traces = list(studies[1:]), []
    for k, name in enumerate(others):
        offset = 0.6 * ((k + 0.5) / len(others) - 0.5)
        rows = table[(table["study"] == name) & table["difference"].notna()]
        for is_paired, some in rows.groupby("paired"):
            place = [keys.index(key) + offset for key in zip(some["sweep"], some["policy"], strict=True)]
            shape = _SHAPES[(k + 1) % len(_SHAPES)]
            look = (uids[name], shape) if is_paired else (f"{uids[name]}open", f"{shape}-open")
            traces.append(_difference_trace(some, place, *look))
    texts = [f"{policy}, {symbol(sweep)}" for sweep, policy in keys]
    edges = [at - 0.5 for at in range(1, len(keys)) if keys[at][0] != keys[at - 1][0]]
    lines = [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": at, "y1": at,
              "line": {"width": 0.6, "color": "#8a949e"}} for at in edges]  # fmt: skip
    up = axis("", tickvals=list(range(len(keys))), ticktext=texts, ticks="", range=[len(keys) - 0.4, -0.6],
              showgrid=False)  # fmt: skip
    return {
        "data": traces,
        "layout": layout(xaxis=axis(f"Difference of QoC to {escape(studies[0])}", zeroline=True), yaxis=up,
                         shapes=lines,
                         hovermode="closest", margin={"l": 120, "r": 14, "t": 14, "b": 48}),
        "height": 110 + 26 * len(keys),
    }  # fmt: skip


def _difference_trace(rows: pd.DataFrame, place: list[float], uid: str, shape: str) -> dict[str, Any]:
    middle = rows["difference"].to_numpy()
    return {
        "type": "scatter", "mode": "markers", "uid": uid, "x": middle, "y": place,
        "error_x": {"type": "data", "symmetric": False, "array": rows["difference_high"].to_numpy() - middle,
                    "arrayminus": middle - rows["difference_low"].to_numpy(), "thickness": 1.3, "width": 3},
        "marker": {"size": 9, "symbol": shape, "line": {"width": 1.5}},
        "customdata": [_hover(row) for row in rows.to_dict("records")],
        "hovertemplate": "%{customdata[0]}<br>%{customdata[1]}<br>difference %{customdata[2]}<extra></extra>",
    }  # fmt: skip


def _hover(row: Mapping[str, Any]) -> list[str]:
    choice = f"{choice_words(row)}, Δ = "
    gap = f"{signed(row['difference'])} {interval(row['difference_low'], row['difference_high'])}"
    return [
        f"<b>{escape(row['study'])}</b>, {escape(row['policy'])}",
        f"{choice}{number(1e3 * row['deadline'])} ms: QoC {plus_minus(row['qoc'], row['qoc_se'])}",
        gap if row["paired"] else f"{gap}, not paired",
    ]


def _curve_chart(curves: pd.DataFrame, sweep: str, uids: Mapping[str, str]) -> dict[str, Any]:
    """QoC over the deadline, a line per study with a band of one standard error."""
    traces: list[dict[str, Any]] = []
    for name, rows in curves.groupby("study", sort=False):
        rows = rows.sort_values("deadline")
        x, y, error = 1e3 * rows["deadline"].to_numpy(), rows["qoc"].to_numpy(), rows["qoc_se"].to_numpy()
        traces.append({"type": "scatter", "mode": "lines", "x": np.concatenate([x, x[::-1]]), "fill": "toself",
                       "y": np.concatenate([y + error, (y - error)[::-1]]), "line": {"width": 0}, "hoverinfo": "skip",
                       "fillcolor": "#808080", "uid": f"{uids[str(name)]}b"})  # fmt: skip
        texts = [[escape(name), value_cell(row), number(1e3 * row["deadline"]),
                  share_text(row["reliability"], row.get("reliability_se", 0.0)), plus_minus(row["qoc"], row["qoc_se"])]
                 for row in rows.to_dict("records")]  # fmt: skip
        traces.append({"type": "scatter", "mode": "lines+markers" if x.size < 12 else "lines", "x": x, "y": y,
                       "line": {"width": 2}, "marker": {"size": 5}, "uid": uids[str(name)], "customdata": texts,
                       "hovertemplate": f"<b>%{{customdata[0]}}</b><br>{symbol(sweep)} = %{{customdata[1]}}, Δ = "
                                        "%{customdata[2]} ms, <i>F</i>(Δ) = %{customdata[3]}<br>QoC %{customdata[4]}"
                                        "<extra></extra>"})  # fmt: skip
    return {"data": traces, "layout": layout(xaxis=axis(DEADLINE), yaxis=axis("QoC"), hovermode="closest",
                                             margin={"l": 62, "r": 14, "t": 14, "b": 48})}  # fmt: skip


def _table(table: pd.DataFrame, studies: Sequence[str]) -> str:
    heads = "".join(f'<th scope="col">{head}</th>' for head in _HEADS)
    bodies = []
    for _, rows in table.groupby("sweep", sort=False):
        order = {key: k for k, key in enumerate(dict.fromkeys(rows["policy"]))}
        lines = sorted(rows.to_dict("records"), key=lambda row: (order[row["policy"]], studies.index(row["study"])))
        bodies.append(
            f"<tbody>{''.join(_row(row, lines[k - 1] if k else None) for k, row in enumerate(lines))}</tbody>"
        )
    return (
        '<div class="scroll" role="region" aria-label="Policies of each study" tabindex="0"><table class="compared">'
        f"<thead><tr>{heads}</tr></thead>{''.join(bodies)}</table></div>"
    )


def _row(row: Mapping[str, Any], before: Mapping[str, Any] | None) -> str:
    sweep, policy = str(row["sweep"]), str(row["policy"])
    gap = ""
    if np.isfinite(row["difference"]):
        gap = f"{signed(row['difference'])} {interval(row['difference_low'], row['difference_high'])}"
        gap += "" if row["paired"] else " not paired"
    share, low, high = (percent(row[f"collision_{name}"]) for name in ("share", "low", "high"))
    close = f"{share} [{low}, {high}]"
    cells = (
        "" if before else f'{symbol(sweep)} <span class="words">{name_of(sweep)}</span>',
        "" if before and before["policy"] == policy else f"{mark(policy)} {escape(policy)}",
        escape(row["study"]), value_cell(row), number(1e3 * row["deadline"]),
        plus_minus(row["qoc"], row["qoc_se"]), number(row["qoc_own_scale"], ".4f"), gap,
        plus_minus(row["auc"], row["auc_se"], ".3f"),
        close if row["within_limit"] else f'<strong class="warn">{close}</strong>',
    )  # fmt: skip
    parts = [f"<th scope=row>{cell}</th>" if k == 2 else f"<td>{cell}</td>" for k, cell in enumerate(cells)]
    return f"<tr>{''.join(parts)}</tr>"
