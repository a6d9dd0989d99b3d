"""Several runs of a study again, with their trajectories, by one compiled program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qocjax._kept import called
from qocjax.batch.drawing import draw_seeds, loops_of
from qocjax.controllers import Controller
from qocjax.network.contention import draw_length
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario, num_ticks
from qocjax.single import Run, simulate
from qocjax.study.axes import values_of
from qocjax.study.chosen import design_of, place_of
from qocjax.study.problem import Problem
from qocjax.study.replayed import replay
from qocjax.study.study import Study

__all__ = ["PolicyRun", "policy_runs", "replays"]

_MOST_STEPS = 6_000_000  # robot-steps that are kept at once


@dataclass(frozen=True)
class PolicyRun:
    """A run of what one policy chose in one sweep."""

    sweep: str
    policy: str
    values: Mapping[str, float]  # of what the sweep varies, by parameter
    design: Design
    reliability: float
    seed: int
    run: Run


def replays(
    scenario: Scenario,
    designs: Sequence[Design],
    network: Network,
    seed: int,
    *,
    rules: Rules | None = None,
    key: int = 0,
    controller: Controller | None = None,
) -> list[Run]:
    """Simulates several designs with one seed: what `replay` does, but compiled once for all.

    Args:
        scenario: As of the evaluation.
        designs: Every value a number; sampling periods may differ.
        network: As of the evaluation.
        seed: The Monte Carlo seed.
        rules: As of the evaluation.
        key: As of the evaluation.
        controller: As of the evaluation; a costly one is run design by design.

    Returns:
        A run of each design, of NumPy arrays.
    """
    rules = rules or Rules()
    if controller is not None and controller.costly:
        options: dict[str, Any] = {"rules": rules, "key": key, "controller": controller}
        return [jax.tree.map(np.asarray, replay(scenario, each, network, seed, **options)) for each in designs]
    ticks = [num_ticks(scenario.horizon, float(np.asarray(design.tau))) for design in designs]
    start, lanes, words = _draw(scenario, network, seed, key, designs, ticks)
    values = [design.values() for design in designs]
    stacked = Design.of({name: np.array([float(v[name]) for v in values], lanes.dtype) for name in values[0]})
    placed = replace(scenario, start=start)
    runs = jax.tree.map(np.asarray, called(_together, (stacked, lanes, placed, words), (rules, controller)))
    return [_cut(jax.tree.map(lambda a, k=k: a[k], runs), count) for k, count in enumerate(ticks)]


def _together(
    designs: Design,
    loop_times: jax.Array,
    scenario: Scenario,
    words: jax.Array,
    rules: Rules,
    controller: Controller | None,
) -> Run:
    """Runs of several designs, each field with them in front."""

    def one(design: Design, times: jax.Array) -> Run:
        return simulate(
            scenario, design, times, rules.actuation, rules.hold, hold_timeout=rules.hold_timeout,
            hold_decay=rules.hold_decay, plan_length=rules.plan_length, controller=controller,
            key=jax.random.wrap_key_data(words),
        )  # fmt: skip

    return jax.vmap(one)(designs, loop_times)


def policy_runs(study: Study, problem: Problem) -> list[PolicyRun]:
    """A run of each policy's choice, all on one seed: the median one of the first.

    Args:
        study: What chose. Of many sweeps with many robots only the best are run again.
        problem: What it simulated; with a costly controller the first sweep only is run again.

    Returns:
        The sweeps whose best choice keeps the limit on collisions first, of these the ones without any, then by its
        QoC; the policies of each in their order. Without what found no design.
    """
    found = study.policies[study.policies["qoc"].notna()]
    joint = found[found["policy"] == "Co-design"]
    unsafe = ~joint["within_limit"].astype(bool)
    order = {"collision_share": 2 * unsafe + (joint["collision_share"] > 0), "qoc": -joint["qoc"]}
    most = 0 if problem.controller is not None and problem.controller.costly else _MOST_STEPS
    chosen: list[tuple[dict[str, Any], Design]] = []
    for sweep in joint.assign(**order).sort_values(["collision_share", "qoc"], kind="stable")["sweep"]:
        rows = found[found["sweep"] == sweep].to_dict("records")
        more = chosen + [(row, design_of(study.results, row)) for row in rows]
        shortest = min(float(np.asarray(design.tau)) for _, design in more)
        if chosen and len(more) * problem.scenario.num_robots * problem.scenario.horizon / shortest > most:
            break
        chosen = more
    if not chosen:
        return []
    seed = _median_seed(study, chosen[0][1])
    runs = _in_setups(problem, [design for _, design in chosen], seed)
    return [
        PolicyRun(row["sweep"], row["policy"], values_of(row), design, row["reliability"], seed, run)
        for (row, design), run in zip(chosen, runs, strict=True)
    ]


def _in_setups(problem: Problem, designs: Sequence[Design], seed: int) -> list[Run]:
    """`replays` of designs, those of one set-up together."""
    stacked = Design.of({name: np.array([float(np.asarray(each.values()[name])) for each in designs])
                         for name in designs[0].names})  # fmt: skip
    found: dict[int, Run] = {}
    for places, setup in problem.groups(stacked):
        own = [problem.numbers(designs[k]) for k in places]
        runs = replays(setup.scenario, own, setup.network, seed, rules=setup.rules, key=problem.key,
                       controller=setup.controller)  # fmt: skip
        found |= dict(zip(places.tolist(), runs, strict=True))
    return [found[k] for k in range(len(designs))]


def _draw(
    scenario: Scenario, network: Network, seed: int, key: int, designs: Sequence[Design], ticks: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start poses, loop times of each design [G, P, N] s, and words of a key.

    All loop times are as long as the longest; loops beyond the horizon are lost.
    """
    most = max(ticks)
    begin = np.asarray(scenario.start, jnp.result_type(float))
    times = np.full((len(designs), most, scenario.num_robots), np.inf, begin.dtype)
    drawn: dict[tuple[int, float], Any] = {}
    found: dict[tuple[float, float], np.ndarray] = {}
    for row, (design, count) in enumerate(zip(designs, ticks, strict=True)):
        tau = float(np.asarray(design.tau))
        deadline = float(np.asarray(design.deadline)) if getattr(network, "uses_deadline", False) else 0.0
        shape = draw_length(network, count, tau, most)
        if shape not in drawn:
            drawn[shape] = draw_seeds(begin, scenario.start_jitter, network, np.array([seed]), key, *shape)
        if (tau, deadline) not in found:
            found[tau, deadline] = np.asarray(loops_of(network, drawn[shape].network, count, tau, deadline))[0]
        times[row, :count] = found[tau, deadline][:count]
    first = next(iter(drawn.values()))
    return np.asarray(first.start)[0], times, np.asarray(first.keys)[0]


def _cut(run: Run, ticks: int) -> Run:
    """A run without the ticks beyond its horizon, in which nothing moves and every loop is lost."""
    age = run.age[:ticks]
    kept: dict[str, Any] = {name: getattr(run, name)[: ticks + 1] for name in ("time", "pose", "reference")}
    return replace(
        run, **kept, command=run.command[:ticks], age=age, age_mean=age.mean(), age_peak=age.max(),
        completed_share=run.completed_share * (run.age.shape[0] / ticks),
        view=jax.tree.map(lambda a: a[:ticks], run.view),
    )  # fmt: skip


def _median_seed(study: Study, design: Design) -> int:
    """The evaluation seed whose AUC under a design is the median."""
    found = study.evaluation
    auc = found["auc"].isel(design=place_of(found, design)).mean("robot").values
    return int(found["seed"].values[np.argsort(auc)[len(auc) // 2]])
