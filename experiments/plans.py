"""Packets of the next commands against holding, stopping and predicting alone, over the deadline: QoC and collisions.

    python experiments/plans.py [stack]

The surrogate law drives the paper's two robots on four networks: the paper's; measured Wi-Fi control loops (CLEAVE,
loop 3) and frames of a Wi-Fi client far from its access point (EdgeDroid), both of ../shared/data or the folder that
QOCJAX_DATA names, and left out without it; and the paper's edge behind an uplink that loses a fifth of the states in
bursts of 0.2 s. All ways share their seeds, so differences are paired. The deadline of each is chosen on seeds of its
own (the largest QoC among those whose collisions keep the limit; of all where none does), and judged on fresh ones.
Writes experiments/results/plans.csv (every deadline, fresh seeds), plans_best.csv and the figure beside them; three
minutes on two cores. With `stack` the navigation stack in the hall, at 20 Hz behind the same bursts: plans_stack.csv
and plans_stack_best.csv, five minutes.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from qocjax import Rules
from qocjax._xla import request_whole_loop
from qocjax.config import conf_dir, load
from qocjax.config.scale import given_scale
from qocjax.config.show import ShowConfig
from qocjax.figures.save import save
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style
from qocjax.quality import QocScale
from qocjax.search.objective import Objective
from qocjax.statistics.estimates import share
from qocjax.statistics.scores import Scores

RESULTS = Path(__file__).resolve().parent / "results"
DATA = Path(os.environ.get("QOCJAX_DATA", Path(__file__).resolve().parents[1] / ".." / "shared" / "data")).resolve()
CLEAVE = DATA / "cleave-wifi-loop/MOSN_20m_wifi_plant6_sample_rate_20/udpclient.plant.3.20211212.032926577813.csv"
EDGEDROID = DATA / "edgedroid-wifi/1Client_100Runs_BadLink/total_frame_stats.csv"
LIMIT = 0.05  # of collisions
ALONE = "M = 1, prediction alone"
LENGTHS = (2, 5, 10, 20, 50)
PLANS = {ALONE: Rules(hold="buffer", plan_length=1)} | {
    f"M = {m}": Rules(hold="buffer", plan_length=m) for m in LENGTHS
}
WAYS = {"hold": Rules(), "zero": Rules(hold="zero")} | PLANS
_COLOURS = dict(zip(WAYS, (GREY, "black", *OKABE_ITO), strict=False))
_LONG = [40, 60, 80, 100, 120, 140, 160, 180, 200, 220, 250, 300, 350, 400, 500, 600, 800]


class Case(NamedTuple):
    """A network, its deadlines (ms), and the seeds to choose and to judge on."""

    options: list[str]
    deadlines_ms: list[int]
    choosing: range = range(256)
    fresh: range = range(1000, 1512)


def bursts(tau: float) -> list[str]:
    """The paper's edge behind an uplink that loses a fifth, in bursts of 0.2 s in the mean."""
    leave = tau / 0.2
    part = "network.uplink.loss"
    return [f"loop.tau={tau}", f"loss@{part}=gilbert_elliott", f"{part}.p_good_to_bad={leave / 4:g}",
            f"{part}.p_bad_to_good={leave:g}"]  # fmt: skip


def trace(path: Path, column: str, unit: str, tau: float) -> list[str]:
    """A measured trace, replayed as it was measured."""
    return ["network=trace", f"network.path='{path}'", f"network.column={column}", f"network.unit={unit}",
            f"network.period={tau}", f"loop.tau={tau}"]  # fmt: skip


def cases(work: Path) -> dict[str, Case]:
    """The networks that there are."""
    made = {"paper's network": Case([], _LONG)}
    if CLEAVE.is_file():
        axis = [3, 4, 5, 6, 8, 10, 12, 15, 20, 30, 40, 60, 80, 100, 150, 200, 300]
        made["measured Wi-Fi"] = Case([*trace(CLEAVE, "rtt", "s", 0.05), "network.sequence=seq"], axis)
    if EDGEDROID.is_file():
        table = pd.read_csv(EDGEDROID).sort_values(["run_id", "client_send"])
        (table["client_recv"] - table["client_send"]).to_frame("rtt").to_csv(work / "far.csv", index=False)
        axis = [20, 25, 30, 35, 40, 45, 50, 60, 80, 100, 150, 200, 300, 400, 600, 800]
        made["measured Wi-Fi, far"] = Case(trace(work / "far.csv", "rtt", "ms", 0.067), axis)
    return made | {"20 % lost in bursts": Case(bursts(0.01), _LONG)}


STACK = Case(["scenario=hall", "controller=navigation", *bursts(0.05)], [200, 250, 300, 400],
             range(8), range(1000, 1016))  # fmt: skip
STACK_LENGTHS = (1, 5, 20)


@dataclass(frozen=True)
class Judged:
    """Runs of one way: QoC and what else is told of them, each [D, S]."""

    scores: Scores
    auc: np.ndarray
    collided: np.ndarray
    closest: np.ndarray

    def __getitem__(self, place: int) -> Judged:
        """Those of one deadline."""
        return Judged(self.scores[place], self.auc[place], self.collided[place], self.closest[place])


class Bench:
    """A case under one controller, on the paper's QoC scale."""

    def __init__(self, case: Case) -> None:
        with initialize_config_dir(str(conf_dir()), version_base="1.3"):
            config = load(ShowConfig, compose("show", ["scenario=paper", *case.options]))
        self.case, self.deadlines = case, np.array(case.deadlines_ms) / 1e3
        scenario = config.build_scenario()
        scale = given_scale("plans", None, None, "paper", scenario)
        assert isinstance(scale, QocScale)  # it is committed; for the type checker
        self._design = config.baseline()
        self._objective = Objective(scenario, config.build_network(), scale, controller=config.build_controller())
        self.reliability = self._objective.reliability(self.deadlines, self._design.tau).share

    def run(self, way: tuple[Rules, bool], deadlines: np.ndarray, seeds: Sequence[int]) -> Judged:
        """Runs at some deadlines; the second of a way is whether the stack predicts."""
        objective = replace(self._objective, rules=way[0])
        if objective.controller is not None and objective.controller.costly:
            objective = replace(objective, controller=replace(objective.controller, predict=way[1]))  # type: ignore
        runs = objective.runs(replace(self._design, deadline=deadlines), seeds)
        auc = runs["auc"].values.mean(axis=-1)
        return Judged(objective.judged(runs), auc, runs["collided"].values, runs["min_distance"].values)


def chosen(found: Judged) -> int:
    """The deadline with the largest QoC among those whose collisions keep the limit, of all where none does."""
    hits, score = found.collided.mean(axis=-1), found.scores.values.mean(axis=-1)
    return int((np.where(hits <= LIMIT, score, -np.inf) if (hits <= LIMIT).any() else score).argmax())


def row(found: Judged, others: dict[str, Judged]) -> dict[str, Any]:
    """What one deadline comes to, with the paired differences of QoC to other ways."""
    values: dict[str, Any] = {"auc": found.auc.mean()}
    columns = [("qoc", found.scores.mean().given)]
    columns += [(f"over_{name}", (found.scores - other.scores).mean().given) for name, other in others.items()]
    columns += [("collided", share(found.collided, found.scores.units))]
    for name, each in columns:
        values |= {name: each.mean, f"{name}_low": each.low, f"{name}_high": each.high}
    return values | {"closest_5": np.quantile(found.closest, 0.05)}


def tables_of(name: str, case: Case, ways: dict[str, tuple[Rules, bool]]) -> tuple[list[dict], list[dict]]:
    """A row for each way and deadline, and for each way at its best deadline, all on fresh seeds."""
    bench = Bench(case)
    judged = {way: bench.run(how, bench.deadlines, case.fresh) for way, how in ways.items()}
    best = {way: chosen(bench.run(how, bench.deadlines, case.choosing)) for way, how in ways.items()}
    against = {"hold": "hold", "alone": ALONE}
    curve = [
        {"network": name, "way": way, "deadline_ms": case.deadlines_ms[k], "reliability": bench.reliability[k]}
        | row(found[k], {short: judged[other][k] for short, other in against.items()})
        for way, found in judged.items() for k in range(bench.deadlines.size)
    ]  # fmt: skip
    at_best = {short: judged[other][best[other]] for short, other in against.items()}
    finals = [
        {"network": name, "way": way, "deadline_ms": case.deadlines_ms[best[way]],
         "reliability": bench.reliability[best[way]]} | row(found[best[way]], at_best)
        for way, found in judged.items()
    ]  # fmt: skip
    return curve, finals


def panels(table: pd.DataFrame, finals: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """Both tables by network."""
    for name, rows in table.groupby("network", sort=False):
        yield str(name), rows, finals[finals["network"] == name]


def draw(table: pd.DataFrame, finals: pd.DataFrame) -> Figure:
    """QoC and collisions over the deadline, a column for each network; dots at the deadlines chosen."""
    parts = list(panels(table, finals))
    with paper_style():
        figure, axes = plt.subplots(2, len(parts), figsize=(DOUBLE_COLUMN, 4.0), sharex="col", sharey="row",
                                    layout="constrained", squeeze=False)  # fmt: skip
        for column, (name, rows, best) in zip(axes.T, parts, strict=True):
            for way, part in rows.groupby("way", sort=False):
                style = {"color": _COLOURS[way], "ls": "-" if way in PLANS else "--"}
                for axis, quantity in zip(column, ("qoc", "collided"), strict=True):
                    axis.plot(part["deadline_ms"], part[quantity], label=way, **style)
                column[0].fill_between(part["deadline_ms"], part["qoc_low"], part["qoc_high"], color=_COLOURS[way],
                                       alpha=0.15, lw=0)  # fmt: skip
                at = best[best["way"] == way].iloc[0]
                column[0].plot(at["deadline_ms"], at["qoc"], "o", ms=3.5, color=_COLOURS[way])
            column[0].set(title=name, xscale="log", ylim=(0.35, 0.68))
            column[1].xaxis.set_major_formatter(ScalarFormatter())
            column[1].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            column[1].xaxis.set_minor_formatter(NullFormatter())
            column[1].set(xlabel="deadline Δ (ms)", ylim=(-0.03, 1.03))
            column[1].axhline(LIMIT, color=GREY, lw=0.6)
        axes[0, 0].set_ylabel("QoC")
        axes[1, 0].set_ylabel("runs with a collision")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(WAYS))
        plt.close(figure)
    return figure


def kept(name: str, found: list[tuple[list[dict], list[dict]]]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Both tables, written."""
    table, finals = (pd.DataFrame([line for part in parts for line in part]) for parts in zip(*found, strict=True))
    table.to_csv(RESULTS / f"{name}.csv", index=False, float_format="%.4g")
    finals.to_csv(RESULTS / f"{name}_best.csv", index=False, float_format="%.4g")
    print(finals.round(3).to_string(index=False))
    return table, finals


def main() -> None:
    """All networks, or the stack."""
    request_whole_loop()
    if "stack" in sys.argv[1:]:
        ways = {"hold": (Rules(), False), "zero": (Rules(hold="zero"), False), "predict, hold": (Rules(), True)}
        ways |= {way: (how, True) for way, how in PLANS.items() if how.plan_length in STACK_LENGTHS}
        kept("plans_stack", [tables_of("stack in the hall", STACK, ways)])
        return
    ways = {way: (how, False) for way, how in WAYS.items()}
    with tempfile.TemporaryDirectory() as work:
        found = [tables_of(name, case, ways) for name, case in cases(Path(work)).items()]
    save(draw(*kept("plans", found)), RESULTS / "plans")


if __name__ == "__main__":
    main()
