"""What the report of a study shows, gathered from the study."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from qocjax.navigation.maps import StaticMap
from qocjax.report.delays import Completion
from qocjax.report.hall import hall_map
from qocjax.report.replay import Replay
from qocjax.report.study import StudyPage
from qocjax.statistics.units import study_remark
from qocjax.study.capacity import at_once_text, usual_load
from qocjax.study.hanging import hanging_of
from qocjax.study.problem import Problem
from qocjax.study.reliability import reliability_of
from qocjax.study.replays import PolicyRun
from qocjax.study.study import Study

__all__ = ["study_page"]

_STEPS = 400  # of the deadline axis, for F(Δ) between the deadlines of the study


def study_page(
    name: str,
    study: Study,
    problem: Problem,
    runs: Sequence[PolicyRun] = (),
    room: StaticMap | None = None,
    baseline: Mapping[str, float] | None = None,
) -> StudyPage:
    """Gathers what `write_study_report` writes.

    Args:
        name: Of the study, as a reader knows it.
        study: What was found.
        problem: What was simulated.
        runs: To be replayed, from `policy_runs`.
        room: The map of the hall.
        baseline: Values by parameter, around which they are swept.
    """
    axis = np.unique(study.results["deadline"])
    deadlines = np.unique(np.append(axis, np.linspace(0.0, axis[-1], _STEPS + 1)))
    replays = [
        Replay(each.sweep, each.policy, each.values, float(np.asarray(each.design.deadline)), each.reliability,
               float(np.asarray(each.design.tau)), each.run)
        for each in runs
    ]  # fmt: skip
    options = study.configuration
    return StudyPage(
        name=name,
        baseline=baseline,
        results=study.results,
        policies=study.policies,
        scale=study.scale,
        network=problem.network.name,
        completion=_completion(study, problem, deadlines),
        about=_about(problem)
        | {"Computations at once": at_once_text(problem.network, *usual_load(study, problem))}
        | ({"The trace": remark} if (remark := _trace_text(study, problem)) else {}),
        config="" if options is None else OmegaConf.to_yaml(OmegaConf.create(dict(options))),
        record=json.dumps(list(study.made_with), indent=2, ensure_ascii=False),
        replays=replays,
        seed=runs[0].seed if runs else None,
        hall=None if room is None else hall_map(room),
        failures=dict(study.failures),
        limit=None if options is None else options.get("max_collision_share"),
        hanging=hanging_of(problem, list(dict.fromkeys(study.results["sweep"]))),
    )


def _trace_text(study: Study, problem: Problem) -> str | None:
    return study_remark(problem.network, study.policies, problem.scenario.horizon, problem.designs.tau)


def _completion(study: Study, problem: Problem, deadlines: np.ndarray) -> list[Completion]:
    """F over the deadline at each sampling period of the study; once where it is the same at all."""
    counts = study.results["tau"].value_counts()
    found = [
        Completion(float(tau), deadlines, reliability_of(problem.network, problem.scenario, deadlines, float(tau)))
        for tau in counts.index
    ]
    same = all(np.array_equal(each.reliability.share, found[0].reliability.share) for each in found)
    return found[:1] if same else found


def _about(problem: Problem) -> dict[str, Any]:
    rules, scenario = problem.rules, problem.scenario
    return {
        "Robots": str(scenario.num_robots),
        "Horizon": f"{scenario.horizon:g} s",
        "Commands": f"{rules.actuation}, {rules.hold}" + (f" of {rules.plan_length}" if rules.plan_length else ""),
        "Key": str(problem.key),
    }
