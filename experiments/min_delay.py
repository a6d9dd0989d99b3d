"""What MinDelay loses to Co-design, by how many loops it asks for: `sweep.min_reliability` decides it.

    python experiments/min_delay.py [--seeds 256] [--out experiments/results]

The paper's MinDelay takes the smallest deadline, at which no loop completes and there is nothing to tune; here it takes
the smallest with F >= min_reliability, 1 % unless told. Writes `min_delay.csv`, a row for each edge, share and sweep,
and `min_delay.png`. Chosen on half as many seeds, judged on others; differences are paired. About 20 s.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from experiments.observations import EDGES, asked
from experiments.settings import GRIDS, Bench
from qocjax import evaluate
from qocjax._xla import request_whole_loop
from qocjax.figures.quantities import parameter
from qocjax.figures.style import DOUBLE_COLUMN, OKABE_ITO, paper_style
from qocjax.scenario import Design
from qocjax.statistics.estimates import estimate
from qocjax.study.policies import min_delay
from qocjax.study.sweep import qoc_by_seed

SHARES = (0.0, 0.0001, 0.001, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 0.9)


def choices(bench: Bench) -> pd.DataFrame:
    """What MinDelay takes in each sweep for each share that the axis has, on the seeds of the choice."""
    rows = []
    for sweep in GRIDS:
        own = bench.study.results[bench.study.results["sweep"] == sweep]
        qoc, reliability = (own.pivot(index="value", columns="deadline", values=n) for n in ("qoc", "reliability"))
        for share in SHARES:
            if reliability.to_numpy().max() < share:
                continue
            value, deadline = min_delay(qoc.to_numpy(), reliability.to_numpy(), share)
            rows.append({
                "min_reliability": share, "sweep": sweep, "value": qoc.index[value],
                "deadline": qoc.columns[deadline], "reliability": reliability.iat[value, deadline],
            })  # fmt: skip
    return pd.DataFrame(rows)


def losses(edge: str, bench: Bench) -> pd.DataFrame:
    """The choices with what they lose to Co-design on the judging seeds, QoC with its paired 95 % interval."""
    table, setting = choices(bench), bench.setting
    designs = [
        replace(setting.baseline, **{row["sweep"]: row["value"], "deadline": row["deadline"]}).values()
        for row in table.to_dict("records")
    ]
    both = Design.of({name: np.array([float(each[name]) for each in designs]) for name in designs[0]})
    runs = evaluate(setting.scenario, both, bench.network, bench.judging, rules=setting.rules)
    scores = qoc_by_seed(runs, bench.study.scale)
    best = {sweep: bench.reached("qoc", sweep, "Co-design") for sweep in GRIDS}
    found = [estimate(best[sweep] - score) for sweep, score in zip(table["sweep"], scores, strict=True)]
    table["qoc"], table["loss"] = scores.mean(axis=1), [each.mean for each in found]
    table["loss_low"], table["loss_high"] = [each.low for each in found], [each.high for each in found]
    table["collision_share"] = runs["collided"].values.mean(axis=1)
    table.insert(0, "edge", edge)
    return table.assign(seeds=len(bench.judging))


def draw(table: pd.DataFrame) -> Figure:
    """Loss over the share that MinDelay asks for, a line for each sweep, a panel for each edge."""
    with paper_style():
        figure = Figure(figsize=(DOUBLE_COLUMN, 2.6), layout="constrained")
        panels = figure.subplots(1, len(EDGES), sharey=True)
        for axes, edge in zip(panels, EDGES, strict=True):
            for colour, sweep in zip(OKABE_ITO, GRIDS, strict=False):
                rows = table[(table["edge"] == edge) & (table["sweep"] == sweep) & (table["min_reliability"] > 0)]
                share = 100 * rows["min_reliability"].to_numpy()
                axes.plot(share, rows["loss"], color=colour, marker="o", ms=2.5, label=parameter(sweep).name)
                axes.fill_between(share, rows["loss_low"], rows["loss_high"], color=colour, alpha=0.3, lw=0)
            axes.axvline(1.0, color="k", lw=0.6, ls="--")
            axes.set_xscale("log")
            axes.set_yscale("symlog", linthresh=0.01)
            axes.set(title=edge.capitalize(), xlabel="Share of loops that MinDelay asks for (%)", ylim=(0, None))
            axes.xaxis.set_major_formatter("{x:g}")
        panels[0].set_ylabel("QoC that it loses to Co-design")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(GRIDS))
    return figure


def text(table: pd.DataFrame) -> str:
    """A line for each share: the least and the largest loss over the sweeps, as Markdown."""
    lines = ["| Edge | MinDelay asks for | its Δ (ms) | QoC lost, least and most of the sweeps |", "|---|---|---|---|"]
    for (edge, share), rows in table.groupby(["edge", "min_reliability"], sort=False):
        ends = [rows.loc[rows["loss"].idxmin()], rows.loc[rows["loss"].idxmax()]]
        told = " to ".join(f"{r['loss']:.4f} [{r['loss_low']:.4f}, {r['loss_high']:.4f}] ({r['sweep']})" for r in ends)
        missing = len(GRIDS) - len(rows)
        told += f"; in {missing} sweeps no Δ has it" if missing else ""
        spread = sorted({f"{1e3 * d:g}" for d in rows["deadline"]}, key=float)
        ends_ms = spread[0] if len(spread) == 1 else f"{spread[0]} to {spread[-1]}"
        lines.append(f"| {edge} | F ≥ {100 * share:g} % | {ends_ms} | {told} |")
    return "\n".join(lines)


def main() -> None:
    """Writes table and figure, and prints a line for each share."""
    given = asked(__doc__)
    request_whole_loop()
    table = pd.concat([losses(edge, Bench(setting, given.seeds)) for edge, setting in EDGES.items()], ignore_index=True)
    table.to_csv(given.out / "min_delay.csv", index=False, float_format="%.5g")
    draw(table).savefig(given.out / "min_delay.png", dpi=150)
    print(text(table))


if __name__ == "__main__":
    main()
