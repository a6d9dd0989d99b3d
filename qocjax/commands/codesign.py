"""`python -m qocjax.codesign`: the best design of the whole space, from a configuration to tables and figures."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from qocjax import _checks
from qocjax.commands.command_line import output_dir
from qocjax.commands.resuming import going_on, resumed
from qocjax.config import load
from qocjax.config.codesign import CodesignConfig
from qocjax.config.scale import yardstick
from qocjax.figures.codesign import draw_codesign
from qocjax.figures.quantities import short_name
from qocjax.quality import QocScale
from qocjax.scenario import Design
from qocjax.search import FIRST, METHODS, Contest, Problem, compete
from qocjax.search.limits import DEMANDS
from qocjax.search.objective import Objective, pilot_scale
from qocjax.search.pareto import demand_front, worker_front
from qocjax.statistics.collisions import is_alone
from qocjax.statistics.scales import scale_text
from qocjax.statistics.units import trace_remark
from qocjax.store import write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.study.capacity import at_once_text
from qocjax.study.edges import bounds_text
from qocjax.study.grid import Grid
from qocjax.study.problem import data_of
from qocjax.study.reliability import load_of
from qocjax.units import printed_unit

__all__ = ["Codesign", "main", "problem_of", "run", "summary"]


@dataclass(frozen=True)
class Codesign:
    """What the command found."""

    contest: Contest
    front: pd.DataFrame | None  # best design of each sampling period; None where it was left out
    workers: pd.DataFrame | None  # best design for each number of workers; None where it was left out
    scale: QocScale
    simulations: int  # of everything
    names: tuple[str, ...]  # of what was searched, but the deadline


def run(config: CodesignConfig, folder: Path | None = None, *, quiet: bool = False) -> Codesign:
    """Searches, judges and draws.

    Args:
        config: What to search.
        folder: Where pieces, tables, figures and the record go; None writes nothing.
        quiet: No progress bar (there is none anyway where standard error is no terminal).

    Raises:
        ValueError: A value of the configuration is out of range, or the folder holds another search.
        OSError: The folder cannot be written, or the disk is full.
    """
    _check_methods(config)
    grid = _beside(config)
    setting = config.build_scenario(), config.build_network(), config.build_controller()
    with going_on(config, folder, data_of(*setting)):
        problem = problem_of(config)
        _check_scarce(config, problem)
        found = _searched(config, problem, grid, quiet)
        if folder is not None:
            _write(found, config, problem, folder)
            if config.figures:
                against = config.front.against if config.front else "loops_per_s"
                draw_codesign(found.contest.curve, found.contest.policies, found.front, folder / "figures",
                              measure=config.search.measure, against=against, workers=found.workers)  # fmt: skip
    return found


def _searched(config: CodesignConfig, problem: Problem, grid: Grid, quiet: bool) -> Codesign:
    """The contest of the methods, and the fronts."""
    methods = config.search.methods
    sweep_seeds, judge_seeds = (len(seeds) for seeds in config.seeds())
    parts = len(methods) * config.search.repetitions + 3
    with tqdm(total=parts, desc="co-design", file=sys.stderr, disable=True if quiet else None) as bar:

        def progress(text: str) -> None:
            bar.update()
            bar.set_description(text)

        contest = compete(
            problem, methods, config.search.budget, config.search.repetitions, grid, sweep_seeds, judge_seeds,
            min_reliability=config.sweep.min_reliability, key=config.key, block=config.search.block,
            choice_seeds=config.search.choice_seeds, finalists=config.search.finalists,
            num_curve_seeds=config.search.curve_seeds, progress=progress,
        )  # fmt: skip
        progress("front of QoC against demand")
        front = workers = None
        if config.front is not None:
            seeds = range(FIRST["judge"], FIRST["judge"] + judge_seeds)
            also = Design.of({name: contest.finals[name].to_numpy(float) for name in problem.space.baseline.names})
            options: dict[str, Any] = {"method": config.front.method, "budget": config.front.budget, "key": config.key}
            front = demand_front(problem, seeds=seeds, also=also, against=config.front.against, **options)
            if config.front.workers:
                workers = worker_front(problem, workers=config.front.workers, seeds=seeds, **options)
    names = (*problem.space.bounds, "tau")
    return Codesign(contest, front, workers, problem.objective.scale, problem.objective.simulations, names)


def _beside(config: CodesignConfig) -> Grid:
    """The one-at-a-time sweeps that searches are compared with, on the values that the space holds."""
    if config.apart():
        raise ValueError(f"sweep.grids: got {', '.join(config.apart())}, expected parameters that a program takes as "
                         "arrays, which a search can change")  # fmt: skip
    grid, names = config.build_grid(), config.build_space().baseline.names
    if beside := [name for name in grid.designs.names if name not in names]:
        raise ValueError(f"sweep.grids: got {', '.join(beside)}, expected bounds of it in search.bounds too")
    rest = config.baseline_with(names).values()
    return replace(grid, designs=Design.of({**rest, **grid.designs.values()}).at(slice(None)))


def _check_methods(config: CodesignConfig) -> None:
    """Checks the methods' names, and that the law has derivatives where they are asked for."""
    smooth = config.controller.declares().smooth
    known = [name for name in METHODS if smooth or not name.endswith("gradient")]
    for method in [*config.search.methods, *([config.front.method] if config.front else [])]:
        if method not in known:
            why = f", as controller={config.controller.law} does not say that it is smooth" if method in METHODS else ""
            raise ValueError(f"search.methods: got {method!r}, expected some of {', '.join(known)}{why}")


def _check_scarce(config: CodesignConfig, problem: Problem) -> None:
    """Checks that what is limited or traded is something that the network tells."""
    front, network = config.front, problem.objective.network
    if front is not None:
        _checks.choice("front.against", front.against, DEMANDS)
        for count in front.workers:
            _checks.count("front.workers", count)
        if front.workers and not getattr(getattr(network, "edge", None), "finite", False):
            raise ValueError(
                f"front.workers: got {front.workers} on {network.name!r}, expected [] without a finite edge"
            )
    asked = config.limits.workers is not None or (front is not None and front.against == "workers")
    if asked and np.isnan(problem.objective.workers(problem.space.tau)).any():
        raise ValueError(f"limits.workers, front.against: got workers on {network.name!r}, expected another demand: it "
                         "does not tell how many computations it had under way")  # fmt: skip


def problem_of(config: CodesignConfig) -> Problem:
    """What a configuration asks to be found; simulates the scale of QoC where none is given."""
    scenario, network, rules = config.build_scenario(), config.build_network(), config.loop.build()
    space, measure, limits, traffic = (
        config.build_space(), config.build_measure(), config.limits.build(),
        config.traffic.build(config.loop.plan_bytes),
    )  # fmt: skip
    controller = config.build_controller()
    config.check_rate(network, min(*space.tau, *np.asarray(config.build_grid().designs.tau)))
    scale = config.scale()
    if scale is None:
        seeds = range(FIRST["pilot"], FIRST["pilot"] + config.sweep.seeds)
        axis = [ms / 1e3 for ms in config.sweep.deadline_ms]
        scale = pilot_scale(scenario, network, config.baseline(), axis, seeds, rules=rules, key=config.key,
                            controller=controller)  # fmt: skip
    objective = Objective(scenario, network, scale, rules, config.key, controller=controller)
    return Problem(objective, space, limits, traffic, measure)


def summary(found: Codesign, measure: str = "mean", limit: float | None = None) -> str:
    """What was found, for a terminal; `limit` on the share of runs with a collision."""
    contest, name = found.contest, "QoC" if measure == "mean" else "CVaR of QoC"
    best, policies = contest.chosen, contest.policies
    table = pd.DataFrame(
        {
            "": [*(f"{row.method} {row.repetition + 1}" for row in contest.finals.itertuples()),
                 *(f"{row.policy} (sweep of {row.sweep})" for row in policies.itertuples())],
        }
    )  # fmt: skip
    rows = pd.concat([contest.finals, policies], ignore_index=True)
    table[f"{name} [95 %]"] = [f"{r.score:.4f} [{r.score_low:.4f}, {r.score_high:.4f}]" for r in rows.itertuples()]
    table["collisions [95 %]"] = [
        "one robot" if is_alone(row.collision_high)
        else f"{row.collision_share:.1%} [{row.collision_low:.1%}, {row.collision_high:.1%}]"
        for row in rows.itertuples()
    ]  # fmt: skip
    for parameter in found.names:
        table[short_name(parameter)] = rows[parameter].map("{:.3g}".format)
    table["Δ (ms)"] = (rows["deadline"] * 1e3).map("{:.4g}".format)
    table["[with J_med's error]"] = [f"[{r.score_whole_low:.4f}, {r.score_whole_high:.4f}]" for r in rows.itertuples()]
    shown = rows["within_limit"].astype(bool)
    table["collisions [95 %]"] += np.where(shown, "", " !")
    lines = [table.to_string(index=False), *([] if shown.all() else ["! not shown to keep the limits"]), ""]
    design = ", ".join(f"{name} = {best[name]:.4g} {printed_unit(name)}".strip() for name in (*found.names, "deadline"))
    if not best["kept_at_choice"]:
        lines.append(f"Infeasible: no design that was met keeps the limits. The least violated one breaks them by "
                     f"{best['excess_at_choice']:.3g} (relative excess, summed): {design}")  # fmt: skip
    else:
        lines.append(f"Chosen: {design} (by {best['method']})")
        if best["feasible"] and limit is not None and best["collision_high"] > limit:
            share, low, high = (f"{best[f'collision_{name}']:.1%}" for name in ("share", "low", "high"))
            lines.append(
                f"Fresh seeds do not show that it keeps collisions within {limit:.1%}: {share} [{low}, {high}]."
            )
        if not best["feasible"]:
            lines.append(f"On fresh seeds it breaks the limits by {best['excess']:.3g}: collisions in "
                         f"{best['collision_share']:.1%} of runs.")  # fmt: skip
        if "difference" in best.index and not pd.isna(best["difference"]):
            first = policies.iloc[0]
            lines.append(
                f"Against the best one-at-a-time design ({first['policy']}, sweep of {first['sweep']}): "
                f"{best['difference']:+.4f} [{best['difference_low']:+.4f}, {best['difference_high']:+.4f}] {name}, "
                f"the best of {len(contest.finals)} searches ({int(contest.finals['simulations'].sum())} simulations); "
                f"the sweeps took {first['simulations']}"
            )
        else:
            lines.append("No one-at-a-time design of the policies keeps the limits.")
        lines += _tie_text(contest.ties)
        if text := bounds_text(best["at_edge"]):
            lines.append(text)
    return "\n".join([*lines, *_front_text(found.front, "sampling periods"), *_front_text(found.workers, "edges")])


def _front_text(front: pd.DataFrame | None, what: str) -> list[str]:
    """How many of the designs of a front are shown to keep the limits, and how many of these nothing beats."""
    if front is None:
        return []
    return [f"Best designs of {len(front)} {what}: {int(front['within_limit'].sum())} are shown to keep the limits, "
            f"{int(front['front'].sum())} of them are on the front."]  # fmt: skip


def _tie_text(ties: pd.DataFrame) -> list[str]:
    """Which of the finalists the fresh seeds cannot tell from the chosen one, and which they find better."""
    better, others = int(ties["better"].sum()), len(ties) - 1 - int(ties["better"].sum())
    lines = []
    if better:
        are = "is" if better == 1 else "are"
        lines = [f"{better} of the finalists {are} better on the fresh seeds, which those of the choice did not show "
                 "(ties.csv)."]  # fmt: skip
    if others:
        return [*lines, f"{others} other finalist{'s' if others > 1 else ''} cannot be told from it (ties.csv)."]
    return lines or ["No other finalist ties with it on these seeds."]


def limits_text(config: CodesignConfig) -> str:
    """The limits in force, in a line."""
    limits = {name: value for name, value in config.limits.model_dump().items() if value is not None}
    text = ", ".join(f"{name} {value:g}" for name, value in limits.items())
    known = " (on fresh seeds; shown to be kept: collisions by the upper end of their interval)"
    return f"Limits: {text}{known if 'collision_share' in limits else ''}." if text else "No limits are set."


def capacity_text(found: Codesign, config: CodesignConfig) -> str:
    """How many computations at once the chosen design takes."""
    best, scenario = found.contest.chosen, config.build_scenario()
    return at_once_text(config.build_network(), load_of(scenario, float(best["tau"])), float(best["deadline"]))


def _write(found: Codesign, config: CodesignConfig, problem: Problem, folder: Path) -> None:
    contest = found.contest
    tables = {"finals": contest.finals, "curve": contest.curve, "ties": contest.ties}
    tables |= {} if contest.policies.empty else {"policies": contest.policies}
    tables |= {} if found.front is None else {"front": found.front}
    tables |= {} if found.workers is None else {"workers": found.workers}
    for name, table in tables.items():
        write_table(folder / name, table)
    best = contest.chosen
    record = {
        "chosen": {name: float(best[name]) for name in problem.space.baseline.names},
        "method": best["method"],
        "kept_limits_at_choice": bool(best["kept_at_choice"]),
        "kept_limits_on_fresh_seeds": bool(best["feasible"]),
        "shown_to_keep_limits": bool(best["within_limit"]),
        "at_edge": best["at_edge"],
        "yardstick": yardstick(problem.objective.scenario),
        "j_med": found.scale.median,
        "j_med_se": found.scale.median_se,
        "j_max": found.scale.largest,
        "first_seeds": FIRST,
        "simulations": found.simulations,
        "key": config.key,
        "network": problem.objective.network.describe(),
        "computations_at_once": capacity_text(found, config),
    }
    write_json(folder / "record.json", record | provenance())


def main(cfg: DictConfig) -> None:
    """Command line."""
    folder = output_dir()
    config = resumed(load(CodesignConfig, cfg), folder)
    found = run(config, folder)
    print(summary(found, config.search.measure, config.limits.collision_share))
    print(f"\n{limits_text(config)}\n{capacity_text(found, config)}")
    best = found.contest.chosen
    if text := trace_remark(config.build_network(), best["deadline"], config.scenario.horizon, best["tau"]):
        print(f"note: {text}")
    print(scale_text(found.scale, "given" if config.scale() else "of the baseline over the deadline axis", True))
    print(f"Tables, figures and the record are in {folder}")
