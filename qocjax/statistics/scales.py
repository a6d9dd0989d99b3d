"""Where J_med and J_max of a QoC come from, and how well a study knows them (model, section 5).

J_med is the median AUC of the runs of a study, and so an estimate: another study's is another, and moves all its QoC
together. J_max is the AUC of robots that never move: worse than that a controller need not be, and it is a constant of
the scenario, where the largest AUC of whatever was simulated changes by a fifth from one set of seeds to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax import _checks
from qocjax._kept import called
from qocjax._xla import as_written
from qocjax.quality import QocScale, initial_norm
from qocjax.reference import reference_origin, reference_path
from qocjax.scenario import Design, Scenario
from qocjax.statistics.estimates import standard_error
from qocjax.statistics.order import scale_of

__all__ = [
    "LARGEST",
    "Parts",
    "StudyScale",
    "largest_auc",
    "measured_scale",
    "scale_of_runs",
    "scale_text",
    "standing_still",
]

LARGEST = ("still", "runs")
"""What J_max is: the AUC of robots that never move, or the largest of all runs (the paper's)."""

Parts = Callable[[], Iterable[tuple[slice, np.ndarray]]]
"""AUC of some runs [G', S', N] with the places of their seeds; called once for each pass."""

_STEPS = 20_000  # of the integral over the horizon
_BAND = 0.05  # of ln J about the median, in which its density is counted
_FEW = 200  # runs that a band must hold


@dataclass(frozen=True)
class StudyScale(QocScale):
    """A scale that was estimated from runs, with what each observation owes to the error of its median."""

    units: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64), compare=False)  # [S'] labels
    influence: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)  # [S'] s, of mean 0


def standing_still(scenario: Scenario) -> float:
    """AUC (s) of robots that stay at their nominal start, the largest of them."""
    placed = jax.tree.map(np.asarray, scenario)
    time, path, norm = called(_way_past, (placed,), (float(scenario.horizon),), as_written)
    x, y = (np.asarray(part, np.float64) for part in path)
    weights, place = np.asarray(scenario.weights, np.float64), np.asarray(scenario.start, np.float64)
    apart = weights[0] * (place[:, 0] - x) ** 2 + weights[1] * (place[:, 1] - y) ** 2
    return float((np.trapezoid(apart, np.asarray(time), axis=0) / np.asarray(norm)).max())


def _way_past(scenario: Scenario, horizon: float) -> tuple[Array, tuple[Array, Array], Array]:
    """Times, the reference then, and what its distance from robots that stand still is relative to."""
    start = jnp.asarray(scenario.start, jnp.result_type(float))
    goal = jnp.broadcast_to(jnp.asarray(scenario.goal, start.dtype), (scenario.num_robots, 2))
    time = jnp.linspace(0.0, horizon, _STEPS + 1)
    norm = initial_norm(scenario, start, goal, reference_origin(start, scenario.reference_per_robot))
    return time, reference_path(time, start, goal, scenario, Design()), norm


def scale_text(scale: QocScale, of: str, columns: bool = False) -> str:
    """What QoC is relative to, in a sentence or two.

    Args:
        scale: J_med and J_max.
        of: What J_med is the median of.
        columns: Whether the tables have intervals with the error of J_med in them.
    """
    text = f"QoC is relative to J_med = {scale.median:.4g} s, the median AUC {of}, and J_max = {scale.largest:.4g} s."
    if not scale.median_se > 0.0:
        return text
    most = 0.25 * scale.median_se / scale.median  # dQ/dJ_med = Q (1 - Q) / J_med
    text += (
        f" Errors and intervals are given this scale; J_med is known to ± {scale.median_se:.2g} s, which moves all QoC "
    )
    return text + f"together, by ± {most:.2g} at most" + (" (columns *_whole_* have it in them)." if columns else ".")


def scale_of_runs(
    auc: np.ndarray, scenario: Scenario, largest: str = "still", units: np.ndarray | None = None
) -> StudyScale:
    """Scale from the AUC of runs [G, S, N], with the error of its median over the seeds."""
    labels = np.arange(auc.shape[1]) if units is None else units
    return measured_scale(lambda: [(slice(0, auc.shape[1]), auc)], labels, largest_auc(scenario, largest))


def largest_auc(scenario: Scenario, largest: str = "still") -> float | None:
    """J_max (s) by its name of `LARGEST`; None for the largest of the runs.

    Raises:
        ValueError: Another name.
    """
    _checks.choice("j_max_of", largest, LARGEST)
    return standing_still(scenario) if largest == "still" else None


def measured_scale(parts: Parts, units: np.ndarray, largest: float | None) -> StudyScale:
    """Scale from runs that need not fit into memory.

    The error of the median is that of the share of runs below it, seed by seed, over the density there.

    Args:
        parts: The runs.
        units: [S] Labels of the seeds, equal where seeds are no observations of their own.
        largest: J_max (s); None for the largest of the runs.

    Raises:
        ValueError: No AUC is finite.
    """
    found = scale_of(lambda: (auc for _, auc in parts()))
    below, count = np.zeros(len(units)), np.zeros(len(units))
    for seeds, auc in parts():
        finite = np.isfinite(auc)
        below[seeds] += ((auc <= found.median) & finite).sum(axis=(0, 2))
        count[seeds] += finite.sum(axis=(0, 2))
    share = below / np.maximum(count, 1)
    influence = (share.mean() - share) / _density(parts, found.median, float(count.sum()))
    error = float(standard_error(influence, units=units)) if len(units) > 1 else 0.0
    top = found.largest if largest is None else largest
    if not np.isfinite(error):
        return StudyScale(found.median, top)
    return StudyScale(found.median, top, error, np.asarray(units), influence)


def _density(parts: Parts, median: float, total: float) -> float:
    """Density of the AUC at its median (1/s)."""
    band = _BAND
    while True:
        inside = sum(int((np.abs(np.log(np.maximum(auc, 1e-30) / median)) <= band).sum()) for _, auc in parts())
        if inside >= min(_FEW, 0.2 * total) or band > 4.0:
            return inside / (total * 2.0 * band * median)
        band *= 2.0
