"""The report of a fleet study: what follows in words, the fleets, the charts, and some fleets to watch."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from omegaconf import OmegaConf

from qocjax.config.fleet import FleetConfig
from qocjax.fleets.tables import FleetStudy, answers
from qocjax.report.charts import legend_item, series_style
from qocjax.report.fleet_charts import (
    LINES,
    USES,
    completion_chart,
    completion_legend,
    qoc_chart,
    style,
    uses_chart,
)
from qocjax.report.fleet_maps import GIVEN, map_chart, steps_chart
from qocjax.report.fleet_replay import REPLAYED, fleet_replays
from qocjax.report.html import escape, interval, number, percent, plus_minus
from qocjax.report.page import Section, details, facts, render, write
from qocjax.report.parts import chart_place
from qocjax.report.replay import replay_data
from qocjax.report.stages import replay_html
from qocjax.store.provenance import provenance
from qocjax.study.capacity import at_once_text, edge_text
from qocjax.study.problem import Problem
from qocjax.study.reliability import load_of, share_text
from qocjax.study.study import Study

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["write_fleet_report"]


def write_fleet_report(
    path: Path, study: FleetStudy, config: FleetConfig, runs: Mapping[int, tuple[Study, Problem]]
) -> Path:
    """Writes the report of a fleet study as one HTML file that needs nothing else.

    Args:
        path: Where it goes.
        study: What was found.
        config: What was asked.
        runs: The study of each fleet and what it simulated, for the replay.

    Returns:
        The file.
    """
    charts: dict[str, Any] = {"qoc": qoc_chart(study), "completion": completion_chart(study)}
    if any(use in study.points for use in USES):
        charts["uses"] = uses_chart(study)
    charts |= {f"map-{given}": map_chart(study, given) for given in study.maps}
    charts |= {} if study.steps.empty else {"steps": steps_chart(study.steps)}
    replays = fleet_replays(runs, study.largest)
    sections = [
        Section("fleets", "Fleets", _fleets(study)),
        *([Section("needs", "Needs", _needs(study))] if study.maps else []),
        Section("loops", "Loop times", _loops(study)),
        *([] if study.steps.empty else [Section("steps", "Steps", _steps(study.steps))]),
        *([Section("replay", "Replay", replay_html(replays, REPLAYED, "Fleet"))] if replays else []),
        Section("setup", "Set-up", _setup(config)),
    ]
    data = {"charts": charts} | ({"replay": replay_data(replays)} if replays else {})
    first, *others = (escape(line) for line in answers(study))
    lead = f"<style>{style()}</style>" + f'<p class="headline">{first}</p>'
    lead += "".join(f"<p>{line}</p>" for line in others) + facts(_facts(study, config, runs))
    name = next(iter(runs.values()))[1].network.name
    return write(path, render(f"Robots on {name}", "Fleet study", lead, sections, data, _FOOTER))


_FOOTER = (
    "<p>QoC is 1 / (1 + min(<i>J</i><sub>max</sub>, <i>J</i>) / <i>J</i><sub>med</sub>), where AUC <i>J</i> is the "
    "squared distance from the reference over time, relative to its initial value; <i>J</i><sub>med</sub> and "
    "<i>J</i><sub>max</sub> are the same for all fleets here. Not in the model: other cells, handover, more than one "
    "bandwidth part. Written by qocjax.</p>"
)


def _facts(study: FleetStudy, config: FleetConfig, runs: Mapping[int, tuple[Study, Problem]]) -> dict[str, str]:
    """What the numbers depend on; values are HTML."""
    options, robots = config.fleet, study.largest or int(study.points["robots"].iloc[0])
    problem = runs[robots][1]
    row = study.points.set_index("robots").loc[robots]
    at_once = at_once_text(problem.network, load_of(problem.scenario, row["tau"]), float(row["deadline"]))
    of = "given" if options.j_med is not None else "of the first fleet"
    return {
        "Network": escape(problem.network.name),
        "Layout": escape(f"{options.layout.kind}, {options.layout.length:g} m to go"),
        "Sampling period": f"{number(1e3 * config.loop.tau)} ms",
        "Horizon": f"{options.horizon:g} s",
        "Seeds": f"{options.seeds} to choose, {options.evaluation_seeds} to judge",
        f"J_med, J_max ({of})": f"{number(study.scale.median)} s, {number(study.scale.largest)} s",
        "Asked": f"QoC ≥ {study.asked.qoc:.4f}, too close in ≤ {percent(study.asked.collision_share)} of the runs "
        "(upper 95 % end)",
        "Key": str(config.key),
        "Computations at once": escape(at_once),
    } | (
        {}
        if study.edge is None
        else {"Edge": escape(edge_text(study.edge, int(study.points["robots"].iloc[-1])).removeprefix("edge: "))}
    )


def _fleets(study: FleetStudy) -> str:
    legend = "".join(
        legend_item(uid, text) for prefix, (uid, text, _) in LINES.items() if f"{prefix}qoc" in study.points
    )
    left = chart_place("qoc", "QoC over the number of robots", after=_legend("Policies", legend))
    text = (
        "<p>Each fleet at its best deadline, chosen on some seeds and judged on others, with 95 % intervals. Dashed is "
        "the target; the grey line is where QoC passes it between two fleets simulated, with its interval over seeds: "
        "the line between them is drawn, not simulated.</p>"
    )
    uses = [use for use in USES if use in study.points]
    if not uses:
        return f"{text}{left}{_table(study, uses)}"
    legend = "".join(legend_item(*USES[use][:2]) for use in uses)
    right = chart_place("uses", "Air and edge in use", after=_legend("In use", legend))
    return f'{text}<div class="pair">{left}{right}</div>{_table(study, uses)}'


def _table(study: FleetStudy, uses: Sequence[str]) -> str:
    """A row per fleet; the largest that keeps what is asked is bold."""
    policies = {prefix: text for prefix, (_, text, _) in LINES.items() if prefix and f"{prefix}qoc" in study.points}
    in_use = [f"{USES[use][1].capitalize()} in use" for use in uses]
    heads = ["Robots", "Δ&nbsp;(ms)", "<i>F</i>(Δ)", "QoC [95 %]", *policies.values(), *in_use,
             "Runs too close [95 %]", "AUC ± SE (s)"]  # fmt: skip
    rows = []
    for row in study.points.to_dict("records"):
        share = f"{percent(row['collision_share'])} {_percents(row['collision_low'], row['collision_high'])}"
        if study.asked.too_close(row):
            share = f'<strong class="warn">{share}</strong>'
        elif study.asked.not_shown(row):
            share += f" limit not shown with {row['seeds']} seeds"
        score = f"{number(row['qoc'], '.4f')} {interval(row['qoc_low'], row['qoc_high'], '.4f')}"
        rows.append([
            str(row["robots"]), number(1e3 * row["deadline"]), share_text(row["reliability"], row["reliability_se"]),
            f'<strong class="warn">{score}</strong>' if row["qoc"] < study.asked.qoc else score,
            *(plus_minus(row[f"{prefix}qoc"], row[f"{prefix}qoc_se"]) for prefix in policies),
            *(_in_use(row, use) for use in uses), share, plus_minus(row["auc"], row["auc_se"], ".3f"),
        ])  # fmt: skip
    bold = [row["robots"] == study.largest for row in study.points.to_dict("records")]
    return _scrolled("Fleets", heads, [
        [f"<strong>{row[0]}</strong>" if strong else row[0], *row[1:]] for row, strong in zip(rows, bold, strict=True)
    ])  # fmt: skip


def _in_use(row: Mapping[str, Any], use: str) -> str:
    """Share in use, and what is offered."""
    offered = row.get(use.replace("usage", "offered"))
    if offered is None:
        return percent(row[use])
    what = f"{offered:.2f} erlang a worker" if use == "edge_usage" else percent(offered)
    return f"{percent(row[use])} ({what} offered)"


def _needs(study: FleetStudy) -> str:
    maps = "".join(
        chart_place(f"map-{given}", f"QoC over robots and {GIVEN.get(given, given).split(' (')[0].lower()}", keys=True)
        for given in study.maps
    )
    text = (
        "<p>Every cell has its own best deadline. The line is the target, drawn between the middles of cells; a cross "
        f"marks cells that do not keep robots too close within {percent(study.asked.collision_share)} of the runs.</p>"
    )
    tables = "".join(_need_table(given, table) for given, table in study.needs.items())
    return f'{text}<div class="{"pair" if len(study.maps) > 1 else ""}">{maps}{tables}</div>'


def _need_table(given: str, table: pd.DataFrame) -> str:
    heads = ["Robots", f"{GIVEN.get(given, given)}: the least tried that keeps all", "QoC alone passes at [95 %]"]
    rows = [
        [str(row["robots"]), "more than were tried" if np.isnan(row["need"]) else f"{row['need']:g}",
         escape(row["beyond"]) if np.isnan(row["crossing"]) else
         f"{number(row['crossing'], '.3g')} {interval(row['crossing_low'], row['crossing_high'], '.3g')}"]
        for row in table.to_dict("records")
    ]  # fmt: skip
    return f"<div>{_scrolled(GIVEN.get(given, given), heads, rows)}</div>"


def _loops(study: FleetStudy) -> str:
    count = study.completion["robots"].nunique()
    words = ""
    if study.completion["reliability_se"].max() > 0:
        words = " It is estimated by simulating the network alone; its standard error stands beside each number."
    place = chart_place("completion", "Loop completion over the deadline", after=completion_legend(study))
    return (
        f"<style>{series_style(count)}</style><p>How many loops complete within a deadline, for each number of robots; "
        f"stars are the best deadlines.{words}</p>{place}"
    )


def _steps(steps: pd.DataFrame) -> str:
    return (
        f"<p>What one step of each kind would change for {int(steps['robots'].iloc[0])} robots: the gain in QoC at the "
        "best deadline of each, paired by seed, with the 95 % interval of each alone, in the order of their gains on "
        "the seeds of the choice. Grey: not told apart from no gain, all steps together.</p>"
        f"{chart_place('steps', 'Gain of one step')}"
    )


def _setup(config: FleetConfig) -> str:
    options = OmegaConf.to_yaml(OmegaConf.create(config.model_dump()))
    return details("All options", options) + details("Versions", json.dumps(provenance(), indent=2, ensure_ascii=False))


def _legend(name: str, items: str) -> str:
    return f'<div class="legend" role="group" aria-label="{escape(name)}">{items}</div>'


def _percents(low: float, high: float) -> str:
    return f"[{number(100 * low, '.3g')}, {number(100 * high, '.3g')}]"


def _scrolled(name: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose first cells head its rows; wide ones scroll by themselves."""
    head = "".join(f'<th scope="col">{each}</th>' for each in heads)
    body = "".join(f"<tr><th scope=row>{first}</th>{''.join(f'<td>{cell}</td>' for cell in others)}</tr>"
                   for first, *others in rows)  # fmt: skip
    return (f'<div class="scroll" role="region" aria-label="{escape(name)}" tabindex="0"><table class="compared">'
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>")  # fmt: skip
