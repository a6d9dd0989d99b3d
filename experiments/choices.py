"""Which of the paper's conclusions hang on a choice that the paper leaves open ([C] in the model): one at a time.

    python experiments/choices.py [--seeds 128] [--out experiments/results] [--redraw]

Every conclusion (`conclusions.py`) is put to the test with every choice changed alone. Writes `choices.csv` (a row for
each pair), `choices.png` (the matrix), `choices.md` (what flips), and, into the package, the flips that a study's page
and terminal name. About 3 minutes on two cores.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from omegaconf import OmegaConf

from experiments.conclusions import CONCLUSIONS, Conclusion
from experiments.settings import Bench, Setting
from experiments.verdicts import UNITS, Finding
from qocjax import Design, Rules, Scenario, kth_5g_network
from qocjax._xla import request_whole_loop
from qocjax.config import conf_dir
from qocjax.figures.style import paper_style
from qocjax.network import Edge

ROOT = Path(__file__).resolve().parents[1]
COLOURS = {"holds": "#BBD9F0", "contradicted": "#F2B48A", "undecided": "0.9"}
DEFAULT = ("default", "")
RESULTS = ROOT / "experiments" / "results"
PACKAGED = ROOT / "qocjax" / "study" / "tables" / "choices.csv"  # what flips, for the page of a study


def crossing() -> Scenario:
    """The scenario of crossing goals, which brings a reference per robot and the distance to the goal."""
    options = OmegaConf.load(conf_dir() / "scenario" / "crossing.yaml")
    start, goal = (np.array(OmegaConf.to_object(options[name]), float) for name in ("start", "goal"))
    per_robot, normaliser = options.reference.per_robot, options.normaliser
    return Scenario(start, goal, reference_per_robot=per_robot, normaliser=normaliser)


def settings() -> dict[tuple[str, str], Setting]:
    """What is simulated for each (choice, value), named as options of the command line."""
    found = {DEFAULT: Setting()}
    for actuation in ("arrival", "instant"):
        found["loop.actuation", actuation] = Setting(rules=Rules(actuation=actuation))
    for hold in ("zero", "timeout", "decay"):
        found["loop.hold", hold] = Setting(rules=Rules(hold=hold))
    for discipline in ("skip", "latest"):
        found["network.edge.discipline", discipline] = Setting(edge=Edge(workers=1, discipline=discipline))
    for reference in ("follow", "uncapped"):
        found["scenario.reference.kind", reference] = Setting(Scenario(reference=reference))
    found["scenario.normaliser", "goal_distance"] = Setting(Scenario(normaliser="goal_distance"))
    found["scenario", "crossing"] = Setting(crossing())
    found["scenario.start_jitter", "[0,0]"] = Setting(Scenario(start_jitter=(0.0, 0.0)))
    found["controller.d_safe", "0.3"] = Setting(baseline=Design(d_safe=0.3))
    found["network", "kth_5g"] = Setting(path=kth_5g_network())
    found["sweep.j_med", "baseline's runs"] = Setting(scale_of_baseline=True)
    for share in ("0", "0.1"):
        found["sweep.min_reliability", share] = Setting(min_reliability=float(share))
    return found


def line(choice: tuple[str, str], conclusion: Conclusion, finding: Finding, seeds: int) -> dict[str, object]:
    """A row of the table: the difference that decides, and how many of all lie on which side."""
    part = finding.deciding
    found, sides = part.interval(), [each.side() for each in finding.parts]
    return {
        "conclusion": conclusion.number, "claim": conclusion.claim, "sweep": conclusion.sweep,
        "choice": choice[0], "value": choice[1], "verdict": finding.verdict,
        "difference": part.what, "estimate": found.mean, "low": found.low, "high": found.high, "unit": part.unit,
        "bound": part.bound, "claimed": "above" if part.above else "below",
        "differences": len(sides), "right": sides.count(1), "wrong": sides.count(-1), "seeds": seeds,
        "note": finding.note,
    }  # fmt: skip


def simulated(seeds: int) -> pd.DataFrame:
    """The table: each conclusion with each choice."""
    request_whole_loop()
    rows, begin = [], time.perf_counter()
    for choice, setting in settings().items():
        bench = Bench(setting, seeds)
        rows += [line(choice, conclusion, conclusion.judge(bench), seeds) for conclusion in CONCLUSIONS]
        print(f"{time.perf_counter() - begin:4.0f} s  {' = '.join(filter(None, choice))}", flush=True)
    return with_flips(pd.DataFrame(rows))


def with_flips(table: pd.DataFrame) -> pd.DataFrame:
    """Adds whether the verdict is the opposite of that with the defaults."""
    usual = table[table["choice"] == DEFAULT[0]].set_index("conclusion")["verdict"]
    before = table["conclusion"].map(usual)
    decided = (table["verdict"] != "undecided") & (before != "undecided")
    table.insert(table.columns.get_loc("verdict") + 1, "flips", decided & (table["verdict"] != before))
    return table


def packaged(table: pd.DataFrame) -> pd.DataFrame:
    """What flips, each with the verdict under the defaults."""
    usual = table[table["choice"] == DEFAULT[0]].set_index("conclusion")["verdict"]
    found = table[table["flips"]].rename(columns={"choice": "option"})
    found.insert(0, "usual_verdict", found["conclusion"].map(usual))
    return found[
        ["conclusion", "claim", "sweep", "option", "value", "usual_verdict", "verdict", "difference", "estimate", "low",
         "high", "unit"]
    ]  # fmt: skip


def number(row: Mapping) -> str:
    """The difference that decides, with its interval."""
    unit = UNITS[str(row["unit"])]
    mean, low, high = (unit.text(row[name]) for name in ("estimate", "low", "high"))
    return f"{mean} [{low}, {high}] {unit.name}"


def in_cell(row: Mapping) -> str:
    """The same in few characters: percent, hundredths of QoC, centimetres; else in its unit."""
    value = 100 * row["estimate"]
    text = f"{value:+.0f}" if abs(value) >= 9.95 else f"{value:+.1f}"
    if row["unit"] not in ("J*", "spread", "share", "QoC", "m"):
        return UNITS[row["unit"]].text(row["estimate"]).replace("-", "−")
    return text.lstrip("+-") if row["unit"] == "share" or not float(text) else text.replace("-", "−")


def draw(table: pd.DataFrame) -> Figure:
    """The matrix: conclusions down, choices across."""
    choices = list(dict.fromkeys(zip(table["choice"], table["value"], strict=True)))
    height, width = len(CONCLUSIONS), len(choices)
    with paper_style():
        figure = Figure(figsize=(11.0, 1.6 + 0.27 * height), layout="constrained")
        axes = figure.subplots()
        for row in table.to_dict("records"):
            x = choices.index((row["choice"], row["value"]))
            y = [each.number for each in CONCLUSIONS].index(row["conclusion"])
            axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, facecolor=COLOURS[row["verdict"]], edgecolor="white"))
            if row["flips"]:
                axes.add_patch(Rectangle((x - 0.44, y - 0.44), 0.88, 0.88, fill=False, edgecolor="black", lw=1.4))
            weight = "bold" if row["flips"] else "normal"
            axes.text(x, y, in_cell(row), ha="center", va="center", fontsize=7.5, weight=weight)
        labels = [f"{each.claim}  {each.number}" for each in CONCLUSIONS]
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), yticks=range(height), yticklabels=labels)
        axes.set_xticks(range(width), [" = ".join(filter(None, each)) for each in choices], rotation=40, ha="left")
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        for side in axes.spines.values():
            side.set_visible(False)
        for x in range(1, width):
            if choices[x][0] != choices[x - 1][0]:
                axes.axvline(x - 0.5, color="black" if x == 1 else "0.5", lw=0.8 if x == 1 else 0.5)
        keys = [Patch(facecolor=colour, label=name) for name, colour in COLOURS.items()]
        keys.append(Patch(facecolor="white", edgecolor="black", label="flips: not as with the defaults"))
        figure.legend(handles=keys, loc="outside lower center", ncols=len(keys))
    return figure


def page(table: pd.DataFrame) -> str:
    """What flips, as Markdown."""
    usual = table[table["choice"] == DEFAULT[0]].set_index("conclusion")
    head = (
        "# Which conclusions hang on a choice\n\nMade by `python experiments/choices.py`; all pairs are in "
        f"[`choices.csv`](choices.csv). Designs are chosen on {table['seeds'].iloc[0] // 2} seeds and judged on "
        f"{table['seeds'].iloc[0]} others; differences are paired, with 95 % intervals, QoC is on the scale of each "
        "study, J\\* is the baseline's AUC at its best Δ there. Shown is the difference that decides: the nearest to "
        "its bound, or the farthest beyond it.\n\n![Conclusions and choices](choices.png)\n\n"
    )
    lines = ["| Conclusion | With the defaults | Choice | Then | |", "|---|---|---|---|---|"]
    order = {each.number: place for place, each in enumerate(CONCLUSIONS)}
    flips = table[table["flips"]].sort_values("conclusion", kind="stable", key=lambda c: c.map(order))
    for row in flips.to_dict("records"):
        before = usual.loc[row["conclusion"]]
        lines.append(
            f"| {row['conclusion']} {row['claim']} | {before['verdict']}: {number(before)} | "
            f"`{row['choice']}={row['value']}` | {row['verdict']}: {number(row)} | {row['difference']} |"
        )
    left = table[table["verdict"] == "undecided"].groupby("conclusion")
    rest = "; ".join(
        f"{name}: " + ", ".join(f"`{c}={v}`" for c, v in zip(each["choice"], each["value"], strict=True))
        for name, each in sorted(left, key=lambda pair: order[pair[0]])
    )
    steady = [c for c in usual.index if not (table[table["conclusion"] == c]["verdict"] != usual["verdict"][c]).any()]
    return head + "\n".join(lines) + f"\n\nUndecided: {rest}.\n\nThe same whatever is chosen: {', '.join(steady)}.\n"


def main() -> None:
    """Puts each conclusion to the test with each choice."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=128, help="to judge on; half as many others to choose on")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--redraw", action="store_true", help="page and figure from the table that is there")
    given = parser.parse_args()
    if given.seeds < 4:
        parser.error(f"--seeds: got {given.seeds}, expected at least 4")
    if given.redraw:
        table = pd.read_csv(given.out / "choices.csv", dtype={"value": str}, keep_default_na=False)
    else:
        table = simulated(given.seeds)
        given.out.mkdir(parents=True, exist_ok=True)
        table.to_csv(given.out / "choices.csv", index=False, float_format="%.5g")
    (given.out / "choices.md").write_text(page(table), encoding="utf-8")
    draw(table).savefig(given.out / "choices.png", dpi=150)
    if given.out.resolve() == RESULTS:
        PACKAGED.parent.mkdir(exist_ok=True)
        packaged(table).to_csv(PACKAGED, index=False, float_format="%.5g")
    print(page(table))


if __name__ == "__main__":
    main()
