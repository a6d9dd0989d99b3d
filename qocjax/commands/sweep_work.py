"""What a study takes: simulation, tables, figures, the report and the record, into a folder or in memory."""

from __future__ import annotations

import sys
from concurrent.futures import Executor, ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np
from tqdm import tqdm

from qocjax.commands.resuming import note
from qocjax.config import StudyConfig
from qocjax.config.scale import yardstick
from qocjax.scenario import Design
from qocjax.single import Run
from qocjax.statistics.units import units_in
from qocjax.store import write_config, write_json, write_table
from qocjax.store.files import digest_of
from qocjax.store.provenance import change_of, provenance
from qocjax.store.study_folder import RECORD, ChunkFolder, study_folder
from qocjax.study import Study, replay
from qocjax.study.arrays import check_arrays, write_arrays
from qocjax.study.capacity import at_once_text, overload_texts, usual_load
from qocjax.study.chosen import design_at, place_of
from qocjax.study.chunks import steps_of
from qocjax.study.grid import Grid
from qocjax.study.problem import Problem
from qocjax.study.reliability import load_of
from qocjax.study.replays import policy_runs
from qocjax.study.sweep import study_of
from qocjax.study.table import column_units, sound

if TYPE_CHECKING:
    import pandas as pd

    from qocjax.navigation import StaticMap

__all__ = ["simulated", "written"]


def written(
    config: StudyConfig,
    problem: Problem,
    grid: Grid,
    room: StaticMap | None,
    folder: Path,
    quiet: bool,
    drawing: Executor | None,
) -> Study:
    """Runs a study, or what of it the folder does not hold yet, and writes all that belongs to it.

    Args:
        config: Its options.
        problem: What is simulated.
        grid: Its designs.
        room: The map of the scenario, if any.
        folder: Where chunks, tables, figures and the record go.
        quiet: No progress bar.
        drawing: A process that draws half of the figures.
    """
    if config.arrays:
        check_arrays()
    with study_folder(folder, config.identity(), problem.data(), note) as chunks:
        write_config(folder, config.model_dump())
        with ThreadPoolExecutor(1) as aside:
            for shown, module in ((config.figures, "qocjax.figures.study"), (config.report, "qocjax.report")):
                if shown:
                    aside.submit(import_module, module)  # takes as long as JAX, and meanwhile the cores simulate
            study = simulated(config, problem, grid, chunks, quiet)
        for text in change_of(study.made_with):
            note(text)
        digests = _write_tables(study, folder)
        if config.arrays:
            write_arrays(study, folder)
        baseline = {name: float(np.asarray(value)) for name, value in config.baseline().values().items()}
        with ThreadPoolExecutor(1) as aside:  # most of a report is compiling what runs the replays
            reported = aside.submit(_write_report, study, problem, room, baseline, folder) if config.report else None
            if config.figures:
                from qocjax.figures.study import draw_study

                draw_study(*sound(study.results, study.policies), lambda: representative_run(study, config, problem),
                           folder / "figures", drawing, config.max_collision_share, baseline)  # fmt: skip
            if reported is not None:
                reported.result()
        _write_record(study, config, problem, digests, chunks.owner, folder)
    return study


def _write_report(
    study: Study, problem: Problem, room: StaticMap | None, baseline: dict[str, float], folder: Path
) -> None:
    from qocjax.report import study_page, write_study_report

    page = study_page(folder.resolve().name, study, problem, policy_runs(study, problem), room, baseline)
    write_study_report(folder / "report.html", page)


def simulated(config: StudyConfig, problem: Problem, grid: Grid, chunks: ChunkFolder | None, quiet: bool) -> Study:
    """Runs a study, with a progress bar; `chunks` holds what is there already, None for memory."""
    selection, evaluation = config.seeds()
    loads = [(setup.network, load_of(setup.scenario, config.loop.tau)) for _, setup in problem.groups(problem.designs)]
    for text in dict.fromkeys(t for each in loads for t in overload_texts(*each, float(grid.deadline.max()))):
        note(text)
    bar = tqdm(
        total=int(steps_of(problem, problem.designs).sum()) * len(selection),
        desc="simulating", unit=" robot-steps", unit_scale=True, file=sys.stderr, disable=True if quiet else None,
    )  # fmt: skip
    with bar, config.engine.open(note) as engine:
        return study_of(
            problem, grid, selection, evaluation,
            min_reliability=config.sweep.min_reliability, scale=config.scale(),
            j_max_of=config.sweep.j_max_of, max_collision_share=config.max_collision_share, shelf=chunks, engine=engine,
            chunk_steps=config.chunk_steps, progress=lambda steps: bar.update(min(steps, bar.total - bar.n)),
        )  # fmt: skip


def representative_run(study: Study, config: StudyConfig, problem: Problem) -> Run:
    """The baseline, at the deadline of its best QoC, on the selection seed whose AUC there is the median."""
    row = _baseline_row(study.results, config.baseline())
    design = design_at(study.results.loc[row])
    runs = study.runs.isel(design=place_of(study.runs, design))
    auc = runs["auc"].mean("robot").values
    seed = int(runs["seed"].values[np.argsort(auc)[len(auc) // 2]])
    setup = problem.setup_of(design)
    run = replay(setup.scenario, problem.numbers(design), setup.network, seed, rules=setup.rules, key=problem.key,
                 controller=setup.controller)  # fmt: skip
    return jax.tree.map(np.asarray, run)


def _baseline_row(results: pd.DataFrame, baseline: Design) -> int:
    """Row of the best QoC among those that hold the baseline; the best of all where no grid holds it.

    What diverged or failed is left out.
    """
    results = results[results["diverged_share"] == 0]
    own = {name: value for name, value in baseline.values().items() if name != "deadline"}
    held = np.all([np.isclose(results[name], value) for name, value in own.items()], axis=0)
    rows = results[held] if held.any() else results
    return int(rows["qoc"].idxmax())


def _write_tables(study: Study, folder: Path) -> dict[str, str]:
    """Writes the tables; returns the digest of each file."""
    paths = []
    for name, table in (("results", study.results), ("policies", study.policies)):
        table = table.copy(deep=False)
        table.attrs = {"units": column_units(table), "configuration": dict(study.configuration or {})}
        paths += write_table(folder / name, table)
    return {path.name: digest_of(path) for path in paths}


def _write_record(
    study: Study, config: StudyConfig, problem: Problem, digests: dict[str, str], owner: dict[str, str], folder: Path
) -> None:
    selection, evaluation = config.seeds()
    record = {
        "yardstick": yardstick(problem.scenario),
        "j_med": study.scale.median,
        "j_med_se": study.scale.median_se,
        "j_max": study.scale.largest,
        "seeds": {"selection": [selection.start, selection.stop], "evaluation": [evaluation.start, evaluation.stop]},
        "units": _stretches(study),
        "key": config.key,
        "network": problem.network.describe(),
        "computations_at_once": at_once_text(problem.network, *usual_load(study, problem)),
        "path": {name: study.runs.attrs[name] for name in ("math", "dtype")},
        "configuration": study.configuration,
        "tables": digests,
        "failures": dict(study.failures),
        "made_with": list(study.made_with),
        "chunks": list(study.chunks),
        "owner": owner,
    }
    write_json(folder / RECORD, record | provenance(problem.controller))


def _stretches(study: Study) -> dict[str, list[int]]:
    """Labels of the seeds of both parts, where seeds share stretches of a trace."""
    parts = {"selection": study.runs, "evaluation": study.evaluation}
    return {name: units_in(runs).tolist() for name, runs in parts.items() if "stretch" in runs.coords}
