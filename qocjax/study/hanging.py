"""Which conclusions of the paper hang on a choice that a study makes, in words (model, the choices [C]).

The numbers are those of `experiments/results/choices.csv`, where each conclusion was put to the test with each choice
changed alone; `tables/choices.csv` holds what flips. They say something of a study on the paper's defaults, or with one
of these choices changed, and nothing of another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np
import pandas as pd

from qocjax.controllers import Apf
from qocjax.network import kth_5g_network, paper_network
from qocjax.network.edge import Edge
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario
from qocjax.study.problem import Problem
from qocjax.tunables import DESIGN

__all__ = ["Hanging", "departures", "hanging_of"]

# What a conclusion rests on where it flips with another choice.
_RESTS_ON = {
    "loop.actuation": "commands being held until t_p + Δ",
    "loop.hold": "a missed loop leaving the last command in force",
    "network.edge.discipline": "an edge that never lets a sample wait",
    "network": "uplink and downlink that take no time",
    "scenario": "one goal for all robots",
    "scenario.reference.kind": "a reference whose κ and ν^max stay fixed",
    "scenario.normaliser": "AUC being relative to the initial disagreement",
    "scenario.start_jitter": "starts that differ from seed to seed",
    "controller.d_safe": "d_safe = 0.5 m",
    "sweep.j_med": "J_med over all runs",
    "sweep.min_reliability": "the F that MinDelay asks for",
}
_UNITS = {
    "J*": (100.0, "+.1f", " % of the baseline's best AUC"),
    "QoC": (1.0, "+.4f", " QoC"),
    "m": (1.0, "+.3f", " m"),
    "s": (1.0, "+.2f", " s"),
    "ms": (1.0, "+.0f", " ms"),
    "times": (1.0, ".0f", " times"),
    "1/s": (1.0, "+g", " 1/s"),
}


class _Choice(NamedTuple):
    option: str
    value: str


class Hanging(NamedTuple):
    """Conclusions that hang on a choice, right for one study; empty where nothing is known of it."""

    text: str = ""  # a paragraph
    numbers: tuple[tuple[str, str, str], ...] = ()  # conclusion, choice with which it flips, difference that decides


@cache
def _table() -> pd.DataFrame:
    with resources.as_file(resources.files("qocjax.study") / "tables" / "choices.csv") as path:
        return pd.read_csv(path, dtype={"value": str})


def hanging_of(problem: Problem, sweeps: Sequence[str]) -> Hanging:
    """What is known of a study: on the defaults, what flips with other choices; with one changed, what does there.

    Args:
        problem: What was simulated.
        sweeps: The parameters that it swept; conclusions on others are left out.
    """
    changed = departures(problem, sweeps)
    if changed is None or len(changed) > 1:
        return Hanging()
    table = _table()
    table = table[table["sweep"].isin(["any", *sweeps])]
    if changed:
        choice = changed[0]
        rows = table[(table["option"] == choice.option) & (table["value"] == choice.value)]
        text = f"With {choice.option}={choice.value}, unlike with the default, {_verdicts(rows)}."
    else:
        rows = table[table["usual_verdict"] == "holds"]
        text = _rests(rows[rows["sweep"] == "any"], rows.loc[rows["sweep"] != "any", "claim"].nunique())
    numbers = [(row["claim"], f"{row['option']}={row['value']}", _number(row)) for row in rows.to_dict("records")]
    return Hanging(text, tuple(numbers)) if numbers else Hanging()


def _rests(rows: pd.DataFrame, others: int) -> str:
    """What the conclusions on deadlines and policies rest on; those on single parameters are counted."""
    parts = []
    for claim, part in rows.groupby("claim", sort=False):
        options = [f"on {_RESTS_ON[option]} ({option})" for option in dict.fromkeys(part["option"])]
        parts.append(f"“{claim}” rests {', '.join(options)}")
    more = f" {others} conclusions on single parameters hang on such choices too." if others > 1 else ""
    return f"What the paper leaves open decides some conclusions: {'; '.join(parts)}.{more}"


def _verdicts(rows: pd.DataFrame) -> str:
    words = {"holds": "holds", "contradicted": "is contradicted"}
    return ", ".join(f"“{row['claim']}” {words[row['verdict']]}" for row in rows.to_dict("records"))


def _number(row: dict) -> str:
    scale, form, unit = _UNITS.get(row["unit"], (100.0, ".1f", " %"))
    mean, low, high = (_signed(format(scale * row[name], form)) for name in ("estimate", "low", "high"))
    return f"{row['difference']}: {mean} [{low}, {high}]{unit}"


def _signed(text: str) -> str:
    return text.replace("-", "−") if float(text) else text.lstrip("+-")


def departures(problem: Problem, sweeps: Sequence[str]) -> list[_Choice] | None:
    """The choices in which a study departs from the paper's defaults; None where it does in anything else.

    Args:
        problem: What was simulated.
        sweeps: The parameters that it swept.
    """
    parts: list[list[_Choice] | None] = [
        _of_rules(problem.rules), _of_network(problem), _of_scenario(problem.scenario), _of_design(problem, sweeps),
        _of_scoring(problem),
    ]  # fmt: skip
    if any(part is None for part in parts) or type(problem.controller or Apf()) is not Apf:
        return None
    return [choice for part in parts if part is not None for choice in part]


def _of_rules(rules: Rules) -> list[_Choice] | None:
    usual = Rules()
    if (rules.hold_timeout, rules.hold_decay) != (usual.hold_timeout, usual.hold_decay):
        return None
    return [
        _Choice(f"loop.{name}", getattr(rules, name))
        for name in ("actuation", "hold")
        if getattr(rules, name) != getattr(usual, name)
    ]


def _of_network(problem: Problem) -> list[_Choice] | None:
    edge = getattr(problem.network, "edge", Edge())
    path = problem.network.describe() | {"edge": None}
    examined = {"paper": paper_network(), "kth_5g": kth_5g_network()}
    name = next((name for name, each in examined.items() if path == each.describe() | {"edge": None}), None)
    if name is None or edge != Edge(discipline=edge.discipline):
        return None
    changed = [] if name == "paper" else [_Choice("network", name)]
    return changed + ([_Choice("network.edge.discipline", edge.discipline)] if edge.finite else [])


def _of_scenario(scenario: Scenario) -> list[_Choice] | None:
    usual, changed = Scenario(), []
    for item in fields(Scenario):
        if not np.array_equal(getattr(scenario, item.name), getattr(usual, item.name)):
            changed.append(item.name)
    names = {"reference": "scenario.reference.kind", "normaliser": "scenario.normaliser"}
    if set(changed) - {*names, "start_jitter"}:
        return None
    if "start_jitter" in changed and any(scenario.start_jitter):
        return None
    values = {"start_jitter": "[0,0]"}
    return [
        _Choice(names.get(name, f"scenario.{name}"), values.get(name) or str(getattr(scenario, name)))
        for name in changed
    ]


def _of_design(problem: Problem, sweeps: Sequence[str]) -> list[_Choice] | None:
    """The baseline is what most designs hold; a parameter that alone is swept has none."""
    found: list[_Choice] = []
    for name in DESIGN:
        if name == "deadline" or [name] == list(sweeps):
            continue
        values, counts = np.unique(getattr(problem.designs, name), return_counts=True)
        value = float(values[counts.argmax()])
        if np.isclose(value, getattr(Design(), name)):
            continue
        if name != "d_safe":
            return None
        found.append(_Choice("controller.d_safe", f"{value:g}"))
    return found


def _of_scoring(problem: Problem) -> list[_Choice] | None:
    options = dict((problem.configuration or {}).get("sweep") or {})
    if any(options.get(name) is not None for name in ("j_med", "j_max", "scale")):
        return None
    share = float(options.get("min_reliability", 0.01))
    return [] if share == 0.01 else [_Choice("sweep.min_reliability", f"{share:g}")]
