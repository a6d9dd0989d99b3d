"""Where J_med and J_max of a QoC come from, and how well a study knows them (model, section 5).

J_med is the median AUC of the runs of a study, and so an estimate: another study's is another, and moves all its QoC
together. J_max is the AUC of robots that never move: worse than that a controller need not be, and it is a constant of
the scenario, where the largest AUC of whatever was simulated changes by a fifth from one set of seeds to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from qocjax import _checks
from qocjax.quality import QocScale, initial_norm
from qocjax.reference import reference_origin, reference_path
from qocjax.scenario import Design, Scenario
from qocjax.study.order import scale_of

__all__ = ["LARGEST", "Parts", "measured_scale", "scale_of_runs", "scale_text", "standing_still"]

LARGEST = ("still", "runs")
"""What J_max is: the AUC of robots that never move, or the largest of all runs (the paper's)."""

Parts = Callable[[], Iterable[tuple[slice, np.ndarray]]]
"""AUC of some runs [G', S', N] with the places of their seeds; called once for each pass."""

_STEPS = 20_000  # of the integral over the horizon
_BAND = 0.05  # of ln J about the median, in which its density is counted
_FEW = 200  # runs that a band must hold


def standing_still(scenario: Scenario) -> float:
    """AUC (s) of robots that stay at their nominal start, the largest of them."""
    start = jnp.asarray(scenario.start, jnp.result_type(float))
    goal = jnp.broadcast_to(jnp.asarray(scenario.goal, start.dtype), (scenario.num_robots, 2))
    time = jnp.linspace(0.0, scenario.horizon, _STEPS + 1)
    x, y = (np.asarray(part, np.float64) for part in reference_path(time, start, goal, scenario, Design()))
    weights, place = np.asarray(scenario.weights, np.float64), np.asarray(scenario.start, np.float64)
    apart = weights[0] * (place[:, 0] - x) ** 2 + weights[1] * (place[:, 1] - y) ** 2
    norm = initial_norm(scenario, start, goal, reference_origin(start, scenario.reference_per_robot))
    return float((np.trapezoid(apart, np.asarray(time), axis=0) / np.asarray(norm)).max())


def scale_text(scale: QocScale, of: str) -> str:
    """What QoC is relative to, in a sentence or two.

    Args:
        scale: J_med and J_max.
        of: What J_med is the median of.
    """
    text = f"QoC is relative to J_med = {scale.median:.4g} s, the median AUC {of}, and J_max = {scale.largest:.4g} s."
    if scale.median_se > 0.0:
        text += (
            f" J_med is known to ± {scale.median_se:.2g} s: errors and intervals beside QoC are given this scale; with "
            "its error in them they are in the columns *_whole_*."
        )
    return text


def scale_of_runs(auc: np.ndarray, scenario: Scenario, largest: str = "still") -> QocScale:
    """Scale from the AUC of runs [G, S, N], with the error of its median over the seeds."""
    return measured_scale(lambda: [(slice(0, auc.shape[1]), auc)], auc.shape[1], scenario, largest)


def measured_scale(parts: Parts, num_seeds: int, scenario: Scenario, largest: str = "still") -> QocScale:
    """Scale from runs that need not fit into memory.

    The error of the median is that of the share of runs below it, seed by seed, over the density there.

    Args:
        parts: The runs.
        num_seeds: S.
        scenario: Says what standing still costs.
        largest: Of `LARGEST`.

    Raises:
        ValueError: No AUC is finite.
    """
    _checks.choice("j_max_of", largest, LARGEST)
    found = scale_of(lambda: (auc for _, auc in parts()))
    below, count = np.zeros(num_seeds), np.zeros(num_seeds)
    for seeds, auc in parts():
        finite = np.isfinite(auc)
        below[seeds] += ((auc <= found.median) & finite).sum(axis=(0, 2))
        count[seeds] += finite.sum(axis=(0, 2))
    share = below / np.maximum(count, 1)
    spread = float(share.std(ddof=1) / np.sqrt(num_seeds)) if num_seeds > 1 else np.inf
    error = spread / _density(parts, found.median, float(count.sum()))
    top = found.largest if largest == "runs" else standing_still(scenario)
    return replace(found, largest=top, median_se=float(error) if np.isfinite(error) else 0.0)


def _density(parts: Parts, median: float, total: float) -> float:
    """Density of the AUC at its median (1/s)."""
    band = _BAND
    while True:
        inside = sum(int((np.abs(np.log(np.maximum(auc, 1e-30) / median)) <= band).sum()) for _, auc in parts())
        if inside >= min(_FEW, 0.2 * total) or band > 4.0:
            return inside / (total * 2.0 * band * median)
        band *= 2.0
