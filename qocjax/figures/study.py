"""All figures of a study, as files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from qocjax.figures.auc_deadline import auc_against_deadline
from qocjax.figures.beside import draw_all
from qocjax.figures.joint_map import joint_map
from qocjax.figures.policy_bars import policy_bars
from qocjax.figures.qoc_map import qoc_map
from qocjax.figures.quantities import short_name
from qocjax.figures.trajectories import RunLike, trajectories
from qocjax.study.axes import axes_of, is_joint

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["draw_study"]


def draw_study(
    results: pd.DataFrame,
    policies: pd.DataFrame,
    run: Callable[[], RunLike],
    folder: Path,
    pool: Executor | None = None,
    limit: float | None = None,
    baseline: Mapping[str, float] | None = None,
) -> list[Path]:
    """Draws the policies' bars, AUC against the deadline, a QoC map for each sweep, and the run's trajectories.

    AUC is drawn for the repulsion gain and the sampling period, as in the paper, or for what is swept without them.

    Args:
        results: Table of the study.
        policies: Table of its policies.
        run: Works out a representative run, while the pool draws.
        folder: Where the files go.
        pool: A process that helps, from `process_beside`.
        limit: Largest share of runs with a collision; None for none.
        baseline: Baseline values by parameter, which is emphasised.

    Returns:
        The files, a PNG and a PDF of each figure.
    """
    sweeps = list(dict.fromkeys(results["sweep"]))
    single = [sweep for sweep in sweeps if not is_joint(sweep)]
    stem = partial(_stem, every=[axis for sweep in sweeps for axis in axes_of(sweep)])
    lines = [sweep for sweep in single if sweep in ("eta", "tau")] or single
    figures = {
        "policies": partial(policy_bars, policies),
        **({stem("auc", lines): partial(auc_against_deadline, results, lines, baseline=baseline)} if lines else {}),
        **{stem("qoc", [sweep]): partial(qoc_map, results, policies, sweep, limit=limit, baseline=baseline)
           for sweep in single},
        **{stem("qoc", axes_of(sweep)): partial(joint_map, results, policies, sweep)
           for sweep in sweeps if is_joint(sweep)},
    }  # fmt: skip
    drawings = [(make, folder / name) for name, make in figures.items()]
    return draw_all(drawings, pool, (lambda: trajectories(run()), folder / "trajectories"))


def _stem(what: str, names: Sequence[str], every: Sequence[str]) -> str:
    """The name of a file about some sweeps; of many sweeps, their number.

    Options go by the ends of their names, or whole where another of `every` ends alike.
    """
    short = Counter(map(short_name, dict.fromkeys(every)))
    stem = "_".join([what, *(short_name(name) if short[short_name(name)] == 1 else name for name in names)])
    return stem if len(stem) <= 100 else f"{what}_{len(names)}_sweeps"
