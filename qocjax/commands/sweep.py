"""`python -m qocjax.sweep`: the paper's study from a configuration to tables and figures."""

from __future__ import annotations

import sys
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from omegaconf import DictConfig

from qocjax.commands.command_line import no_collection, output_dir
from qocjax.commands.resuming import note, resumed
from qocjax.config import StudyConfig, load
from qocjax.store.study_folder import read_record

if TYPE_CHECKING:
    from qocjax.study import Study

__all__ = ["main", "run"]


def run(
    config: StudyConfig, folder: Path | None = None, *, quiet: bool = False, drawing: Executor | None = None
) -> Study:
    """Runs the study of a configuration, or what of it the folder does not hold yet.

    Args:
        config: What to simulate.
        folder: Where chunks, tables, figures and the record go; None keeps all in memory.
        quiet: No progress bar (there is none anyway where standard error is no terminal).
        drawing: A process that draws half of the figures, from `process_beside`.

    Raises:
        ValueError: A value of the configuration is out of range, or the folder holds another study.
        OSError: The folder cannot be written, or the disk is full.
    """
    problem, grid = config.build_problem(), config.build_grid()
    room = config.build_map()
    with no_collection():  # takes as long as JAX: after what may refuse
        from qocjax.commands.sweep_work import simulated, written

    for text in config.beyond():
        note(text)
    if (remark := config.rate_remark(problem.network, float(np.min(problem.designs.tau)))) is not None:
        note(remark)
    if folder is None:
        return simulated(config, problem, grid, None, quiet)
    return written(config, problem, grid, room, folder, quiet, drawing)


def _hanging_text(study: Study, config: StudyConfig) -> str:
    """The conclusions of the paper that hang on a choice of the configuration; nothing where none is known to."""
    from qocjax.study.hanging import hanging_of

    return hanging_of(config.build_problem(), list(dict.fromkeys(study.results["sweep"]))).text


def main(cfg: DictConfig, drawing: Executor | None = None) -> None:
    """Command line; `drawing` draws half of the figures."""
    folder = output_dir()
    config = resumed(load(StudyConfig, cfg), folder)
    study = run(config, folder, drawing=drawing)
    from qocjax.commands.sweep_page import page

    computations = read_record(folder)["computations_at_once"]
    print(page(study, config, config.build_network(), computations))
    if text := _hanging_text(study, config):
        print(text)
    print(f"Tables, figures and the record are in {folder}")
    if study.failures:
        causes = "; ".join(sorted(set(study.failures.values())))
        print(f"error: {len(study.failures)} chunks failed ({causes}); their rows are marked in the tables, "
              f"resume={folder} tries them again", file=sys.stderr)  # fmt: skip
        sys.exit(1)
