"""`python -m qocjax.fleet`: how many robots a network carries, and what they need of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from qocjax.commands.command_line import output_dir
from qocjax.commands.resuming import note, resumed
from qocjax.config import load
from qocjax.config.fleet import FleetConfig
from qocjax.figures.fleet import draw_fleet
from qocjax.fleets import Asked, Point, point_of
from qocjax.fleets.tables import (
    FleetStudy,
    answers,
    collision_text,
    find_limit,
    map_table,
    need_table,
    points_table,
    steps_table,
)
from qocjax.quality import QocScale
from qocjax.report.fleet import write_fleet_report
from qocjax.statistics.collisions import is_alone
from qocjax.statistics.scales import scale_text
from qocjax.store import write_config, write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.store.study_folder import PARTS, RECORD, study_folder
from qocjax.study.capacity import overload_texts
from qocjax.study.chunks import Engine
from qocjax.study.engine import LocalEngine
from qocjax.study.problem import Problem
from qocjax.study.reliability import load_of, reliability_of, share_text
from qocjax.study.study import Study
from qocjax.study.sweep import study_of

__all__ = ["fleet_text", "main", "run"]

T = TypeVar("T")
Runs = Mapping[int, tuple[Study, Problem]]  # of each fleet
_Fleet = tuple[Point, Study, Problem]


@dataclass(frozen=True)
class _Task:
    """One fleet to be studied."""

    name: str  # of its folder
    robots: int
    changes: Mapping[str, Any] = field(default_factory=dict)  # to the options
    grids: Mapping[str, list[float]] = field(default_factory=dict)  # what the policies tune


@dataclass(frozen=True)
class _Runner:
    """Runs studies of fleets, each in a folder of its own, so that what is finished stays."""

    config: FleetConfig
    folder: Path | None
    engine: Engine
    told: Callable[[str], object]

    def points(self, tasks: Sequence[_Task], scale: QocScale) -> list[Point]:
        """Several fleets, of which only the best deadline is asked."""
        return self._beside(lambda task: self.fleet(task, scale)[0], tasks)

    def fleets(self, tasks: Sequence[_Task], scale: QocScale) -> list[_Fleet]:
        """Several fleets whole."""
        return self._beside(lambda task: self.fleet(task, scale), tasks)

    def fleet(self, task: _Task, scale: QocScale | None) -> _Fleet:
        """A fleet; what was simulated of its network is used at once, while it is kept."""
        study, problem = self._study(task, scale)
        found = point_of(study, problem), study, problem
        self.told(task.name)
        return found

    def _beside(self, find: Callable[[_Task], T], tasks: Sequence[_Task]) -> list[T]:
        """On this machine two at a time, since much of each is compiling on one core."""
        with ThreadPoolExecutor(2 if isinstance(self.engine, LocalEngine) else 1) as threads:
            pending = [threads.submit(find, task) for task in tasks]
            try:
                return [each.result() for each in pending]
            finally:
                for each in pending:
                    each.cancel()

    def _study(self, task: _Task, scale: QocScale | None) -> tuple[Study, Problem]:
        """The study of one fleet; what its folder holds is not computed again."""
        config = self.config.study(task.robots, scale, task.changes, task.grids)
        problem, grid = config.build_problem(), config.build_grid()
        shares = reliability_of(problem.network, problem.scenario, problem.designs.deadline, problem.designs.tau).share
        least = min(self.config.fleet.min_reliability, float(shares.max()))
        place = None if self.folder is None else self.folder / PARTS / task.name
        with study_folder(place, config.identity(), problem.data(), note) if place else nullcontext() as shelf:
            found = study_of(
                problem, grid, *config.seeds(), min_reliability=least, scale=scale or config.scale(),
                max_collision_share=config.max_collision_share, shelf=shelf,
                engine=self.engine, chunk_steps=config.chunk_steps,
            )  # fmt: skip
        return found, problem


def run(config: FleetConfig, folder: Path | None = None, *, quiet: bool = False) -> FleetStudy:
    """Works out what a configuration asks.

    Args:
        config: Fleets and their network.
        folder: Where studies, tables, figures and the record go; None keeps all in memory.
        quiet: No progress bar (there is none anyway where standard error is no terminal).

    Raises:
        ValueError: A value of the configuration is out of range, the first fleet completes too few loops by any
            deadline, or the folder holds another study.
        OSError: The folder cannot be written, or the disk is full.
    """
    config.check()
    _check_loops(config)
    outer = study_folder(folder, config.identity(), "", note) if folder else nullcontext()
    bar = tqdm(total=_studies(config), desc="fleets", file=sys.stderr, disable=True if quiet else None)
    with outer, bar, config.engine.open(note) as engine:

        def told(name: str) -> None:
            bar.set_postfix_str(name)
            bar.update()

        found, runs = _simulate(config, _Runner(config, folder, engine, told))
        if folder is not None:
            _write(found, config, runs, folder)
    return found


def _check_loops(config: FleetConfig) -> None:
    """Refuses a network that is dead to the first fleet already: all else is measured by what that one reaches."""
    options = config.fleet
    problem = config.study(options.robots[0], config.scale()).build_problem()
    longest = max(options.deadline_ms) / 1e3
    share = float(reliability_of(problem.network, problem.scenario, longest, config.loop.tau).share)
    if share == 0.0 or share < options.min_reliability:
        robots = f"{options.robots[0]} robot{'' if options.robots[0] == 1 else 's'}"
        raise ValueError(
            f"fleet.deadline_ms: got {max(options.deadline_ms):g} ms at most, by which {share:.3g} of the loops of "
            f"{robots} complete on {problem.network.name}, expected "
            f"{f'at least {options.min_reliability:g} (fleet.min_reliability)' if options.min_reliability else 'more'}"
            ": a larger deadline, or a faster network (its times are in seconds)"
        )


def _studies(config: FleetConfig) -> int:
    options = config.fleet
    maps = len(options.map.robots) * sum(len(axis) for _, axis in config.axes().values())
    return len(options.robots) + maps + (len(config.steps()) + 1 if options.steps else 0)


def _simulate(config: FleetConfig, runner: _Runner) -> tuple[FleetStudy, Runs]:
    options = config.fleet
    tasks = [_Task(f"robots-{robots}", robots, grids=options.grids) for robots in options.robots]
    found = [runner.fleet(tasks[0], config.scale())]
    scale = config.scale() or found[0][1].scale
    found += runner.fleets(tasks[1:], scale)
    points, runs = [each[0] for each in found], {each[0].robots: each[1:] for each in found}
    _warn(runs, max(options.deadline_ms) / 1e3)
    asked = Asked(
        options.target if options.target is not None else options.target_share * float(points[0].scores.mean()),
        options.max_collision_share,
    )
    largest, limit = find_limit(points, asked)
    cells = {given: _map(runner, scale, options.map.robots, given, *axis) for given, axis in config.axes().items()}
    study = FleetStudy(
        points_table(points), _completion(runs),
        {given: map_table(each, given) for given, each in cells.items()},
        {given: need_table(each, given, asked) for given, each in cells.items()},
        _steps(config, runner, scale, largest) if options.steps else pd.DataFrame(),
        asked, largest, limit, scale, getattr(runs[points[0].robots][1].network, "edge", None),
        options.target is not None and config.scale() is None,
    )  # fmt: skip
    return study, runs


def _map(
    runner: _Runner, scale: QocScale, fleets: list[int], given: str, option: str, amounts: list[int]
) -> dict[tuple[int, int], Point]:
    """Fleets by how much they are given of something."""
    cells = [(robots, amount) for robots in fleets for amount in amounts]
    tasks = [_Task(f"robots-{n}-{given}-{amount}", n, {option: amount}) for n, amount in cells]
    return dict(zip(cells, runner.points(tasks, scale), strict=True))


def _steps(config: FleetConfig, runner: _Runner, scale: QocScale, largest: int | None) -> pd.DataFrame:
    """Gain of each step at the first fleet that misses what is asked, or the largest one."""
    robots = config.fleet.robots
    here, steps = next((n for n in robots if n > (largest or 0)), robots[-1]), config.steps()
    tasks = [_Task(f"robots-{here}-step-{k}", here, changes) for k, changes in enumerate([{}, *steps.values()])]
    base, *others = runner.points(tasks, scale)
    return steps_table(base, dict(zip(steps, others, strict=True)))


def _completion(runs: Runs) -> pd.DataFrame:
    """F over the deadline for each fleet."""
    rows = []
    for robots, (study, problem) in runs.items():
        tau = float(study.results["tau"].iloc[0])
        axis = np.unique(study.results["deadline"])
        if not getattr(problem.network, "uses_deadline", False):
            axis = np.union1d(axis, np.linspace(0.0, axis[-1], 161))
        share, error = reliability_of(problem.network, problem.scenario, axis, tau)
        rows.append(pd.DataFrame({"robots": robots, "deadline": axis, "reliability": share, "reliability_se": error}))
    return pd.concat(rows, ignore_index=True)


def _warn(runs: Runs, deadline: float) -> None:
    """Says from which fleet on a queue never ends."""
    for robots, (study, problem) in runs.items():
        load = load_of(problem.scenario, float(study.results["tau"].iloc[0]))
        if texts := overload_texts(problem.network, load, deadline):
            note(f"{robots} robots: " + "; ".join(texts))
            return


def fleet_text(study: FleetStudy) -> str:
    """The table of fleets and what follows from it, for a terminal."""
    rows = study.points
    table = {
        "robots": rows["robots"],
        "Δ (ms)": (1e3 * rows["deadline"]).map("{:g}".format),
        "F(Δ)": [*map(share_text, rows["reliability"], rows["reliability_se"])],
        "QoC ± SE": [f"{q:.4f} ± {se:.4f}" for q, se in zip(rows["qoc"], rows["qoc_se"], strict=True)],
    }
    for policy in ("co_design", "min_delay", "max_rel"):
        name = {"co_design": "Co-design", "min_delay": "MinDelay", "max_rel": "MaxRel"}[policy]
        column = policy.replace("min_delay", "mindelay").replace("max_rel", "maxrel")
        table[name] = rows[f"{column}_qoc"].map("{:.4f}".format)
    for use, name in (("uplink_usage", "up"), ("edge_usage", "edge"), ("downlink_usage", "down")):
        if use in rows:
            table[name] = rows[use].map("{:.0%}".format)
        if (offered := use.replace("usage", "offered")) in rows:
            text = "{:.2f} erl" if name == "edge" else "{:.0%}"
            table[f"{name} offered"] = rows[offered].map(text.format)
    marks = np.select([study.asked.too_close(rows), study.asked.not_shown(rows)], [" !", " ?"], "")
    close = ["one robot" if is_alone(row["collision_high"]) else collision_text(row) for row in rows.to_dict("records")]
    table["collisions"] = [text + mark for text, mark in zip(close, marks, strict=True)]
    return pd.DataFrame(table).to_string(index=False) + "\n\n" + "\n".join(answers(study))


def _write(study: FleetStudy, config: FleetConfig, runs: Runs, folder: Path) -> None:
    write_config(folder, config.model_dump())
    tables = {"fleet": study.points, "completion": study.completion}
    tables |= {f"map_{given}": table for given, table in study.maps.items()}
    tables |= {f"need_{given}": table for given, table in study.needs.items()}
    tables |= {} if study.steps.empty else {"steps": study.steps}
    for name, table in tables.items():
        write_table(folder / name, table)
    if config.figures:
        draw_fleet(study, folder / "figures")
    if config.report:
        write_fleet_report(folder / "report.html", study, config, runs)
    first = next(iter(runs.values()))[1]
    record = {
        "j_med": study.scale.median, "j_med_se": study.scale.median_se, "j_max": study.scale.largest,
        "target": study.asked.qoc, "answers": answers(study), "network": first.network.describe(),
        "key": config.key,
    }  # fmt: skip
    write_json(folder / RECORD, record | provenance())


def main(cfg: DictConfig) -> None:
    """Command line."""
    folder = output_dir()
    config = resumed(load(FleetConfig, cfg), folder)
    study = run(config, folder)
    print(fleet_text(study))
    print(f"\n{scale_text(study.scale, 'given' if config.scale() else 'of the first fleet', True)}")
    print(f"Tables, figures and the record are in {folder}")
