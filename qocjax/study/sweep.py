"""The paper's study: sweeps on some seeds, policies chosen there, and judged on others (model, section 6)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax._room import check_room
from qocjax.controllers import Controller
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Scenario
from qocjax.statistics.scales import LARGEST, largest_auc, measured_scale
from qocjax.statistics.units import with_units
from qocjax.store.memory import InMemory, Shelf
from qocjax.study.choosing import picks, places_of
from qocjax.study.chunks import CHUNK_STEPS, Engine, Part
from qocjax.study.engine import LocalEngine
from qocjax.study.grid import Grid
from qocjax.study.judging import judged_policies
from qocjax.study.parts import PartRuns, run_part
from qocjax.study.policies import MIN_RELIABILITY, min_delay
from qocjax.study.problem import Problem
from qocjax.study.study import Study
from qocjax.study.table import qoc_by_seed, results_table
from qocjax.study.ties import tie_columns

__all__ = ["qoc_by_seed", "results_table", "run_study", "study_of"]

_SEED_BYTES = 100  # in memory, of a seed while it is checked


def run_study(
    scenario: Scenario,
    grid: Grid,
    network: Network,
    selection_seeds: Sequence[int],
    evaluation_seeds: Sequence[int],
    *,
    rules: Rules | None = None,
    key: int = 0,
    min_reliability: float = MIN_RELIABILITY,
    scale: QocScale | None = None,
    max_collision_share: float | None = None,
    progress: Callable[[int], object] | None = None,
    controller: Controller | None = None,
) -> Study:
    """Sweeps the grid, lets each policy choose, and judges the choices on fresh seeds; all in memory.

    Args:
        scenario: Robots and yardstick.
        grid: Designs, from `one_at_a_time`.
        network: Where loop times come from.
        selection_seeds: Seeds on which designs are chosen.
        evaluation_seeds: Other seeds, on which the chosen are judged.
        rules: Actuation and hold.
        key: Root of all random numbers.
        min_reliability: What MinDelay asks of F(Delta).
        scale: J_med and J_max, where given; else of all selection runs.
        max_collision_share: Largest share of runs with a collision that a choice may have; None for the paper's
            policies, which know no such limit.
        progress: Called with robot-steps done.
        controller: What computes the commands, by default the surrogate law.

    Raises:
        ValueError: Seeds in both sets, fewer than two in one, or what `evaluate` raises.
    """
    problem = Problem(scenario, grid.designs, network, rules or Rules(), key, controller)
    return study_of(
        problem, grid, selection_seeds, evaluation_seeds,
        min_reliability=min_reliability, scale=scale, max_collision_share=max_collision_share,
        progress=progress or (lambda steps: None),
    )  # fmt: skip


def study_of(
    problem: Problem,
    grid: Grid,
    selection_seeds: Sequence[int],
    evaluation_seeds: Sequence[int],
    *,
    min_reliability: float = MIN_RELIABILITY,
    scale: QocScale | None = None,
    j_max_of: str = "still",
    max_collision_share: float | None = None,
    shelf: Shelf | None = None,
    engine: Engine | None = None,
    chunk_steps: float = CHUNK_STEPS,
    progress: Callable[[int], object] = lambda steps: None,
) -> Study:
    """Does what `run_study` does, chunk by chunk: what the shelf holds already is not computed again.

    The tables depend on nothing but the problem and the arguments that are not `shelf`, `engine` or `progress`: they
    are made from what the shelf holds when all is there, in one order.

    Args:
        problem: What is simulated; its designs are the grid's.
        grid: The rows of the table.
        selection_seeds: Seeds on which designs are chosen.
        evaluation_seeds: Other seeds, on which the chosen are judged.
        min_reliability: What MinDelay asks of F(Delta).
        scale: J_med and J_max, where given; else J_med is that of all selection runs.
        j_max_of: What J_max is where no scale is given, see `scales.LARGEST`.
        max_collision_share: Largest share of runs with a collision that a choice may have; None for the paper's
            policies, which know no such limit.
        shelf: Where results of chunks are kept; None for memory.
        engine: What computes chunks; None for this process.
        chunk_steps: Robot-steps of a chunk.
        progress: Called with the robot-steps of each chunk that is there.

    Raises:
        ValueError: Seeds in both sets, fewer than two in one, or what `evaluate` raises.
        OSError: The shelf cannot be written to.
    """
    selection, evaluation = _checked_seeds(selection_seeds, evaluation_seeds)
    _checks.bounded("min_reliability", min_reliability, least=0, most=1)
    if max_collision_share is not None:
        _checks.bounded("max_collision_share", max_collision_share, least=0, most=1)
    _checks.bounded("chunk_steps", chunk_steps, above=0)
    _checks.choice("j_max_of", j_max_of, LARGEST)
    reliability = problem.reliability()
    for sweep in dict.fromkeys(grid.sweep):  # raises before anything is simulated
        shares = reliability.share[grid.design[grid.rows(sweep)]]
        min_delay(np.zeros(shares.shape), shares, min_reliability)
    rest = (shelf or InMemory(), engine or LocalEngine(), chunk_steps, progress)
    first = run_part(problem, Part("selection", selection), *rest)
    units = [problem.units(seeds) for seeds in (selection, evaluation)]
    most = [largest_auc(setup.scenario, j_max_of) for _, setup in problem.groups(problem.designs)]
    largest = None if None in most else max(each for each in most if each is not None)
    scale = scale or measured_scale(lambda: _auc_parts(first), units[0], largest)
    results = results_table(first.runs, grid, reliability, scale, first.failed, units[0])
    chosen = picks(results, grid, min_reliability, max_collision_share)
    at = places_of(chosen, grid)
    places = np.unique(grid.design[list(at)])
    if not len(places):
        raise ValueError("policies: got no design that neither diverged nor failed, expected at least one to choose")
    second = run_part(problem, Part("evaluation", evaluation, tuple(places.tolist())), *rest)
    policies, chosen = judged_policies(results, chosen, at, second, scale, units[1], max_collision_share)
    policies = policies.join(
        pd.DataFrame(tie_columns(first.runs, grid, results, chosen, scale, units[0], max_collision_share))
    )
    made_with = {str(each): each for each in (*first.made_with, *second.made_with)}
    held = [part.runs if shelf else part.runs.load() for part in (first, second)]
    runs, judged = (with_units(part, labels) for part, labels in zip(held, units, strict=True))
    failures = {**first.failures, **second.failures}
    return Study(
        results, policies, scale, runs, judged, failures, (*first.names, *second.names), tuple(made_with.values()),
        problem.configuration, problem.network.describe(),
    )  # fmt: skip


def _auc_parts(part: PartRuns) -> Iterator[tuple[slice, np.ndarray]]:
    """AUC of the chunks that are there, with the places of their seeds."""
    for chunk in part.chunks:
        yield slice(*chunk.seeds), part.shelf.array(chunk.name, "auc")


def _checked_seeds(selection: Sequence[int], evaluation: Sequence[int]) -> tuple[Sequence[int], Sequence[int]]:
    """The seeds, as ranges or tuples."""
    found: list[Sequence[int]] = []
    for name, seeds in (("selection_seeds", selection), ("evaluation_seeds", evaluation)):
        if hasattr(seeds, "__len__"):
            check_room(name, f"{len(seeds):.4g} seeds", _SEED_BYTES * len(seeds), "fewer")
        numbers = _checks.counts(name, seeds)
        if len(numbers) < 2 or len(set(numbers)) != len(numbers):
            raise ValueError(
                f"{name}: got {len(numbers)} seeds, {len(set(numbers))} distinct, expected at least 2, all distinct"
            )
        found.append(seeds if isinstance(seeds, range) else tuple(numbers))
    if common := sorted(set(selection) & set(evaluation)):
        raise ValueError(f"evaluation_seeds: got {common[0]} in both sets, expected fresh seeds")
    return found[0], found[1]
