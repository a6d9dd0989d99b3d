"""The policies' choices on fresh seeds: QoC, AUC and collisions with their intervals, differences to Co-design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from qocjax.quality import QocScale
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.estimates import estimate
from qocjax.statistics.scores import Scores
from qocjax.study.axes import axes_of, is_joint
from qocjax.study.choosing import Pick
from qocjax.study.edges import edges_of
from qocjax.study.parts import PartRuns

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["judged_policies"]

_FREE = ("value", "deadline", "qoc", "qoc_se", "collision_share")


def judged_policies(
    results: pd.DataFrame,
    chosen: Sequence[Pick],
    places: Mapping[int, int],
    evaluation: PartRuns,
    scale: QocScale,
    units: np.ndarray,
    limit: float | None = None,
) -> tuple[pd.DataFrame, list[Pick]]:
    """A row per sweep and policy, and the choices that the rows are.

    Where fresh seeds do not bear out that a choice keeps the limit on collisions, the row is what the policy takes in
    the paper, without a limit: what seemed safe is often a robot that hardly moves.

    Args:
        results: On the seeds of the choice.
        chosen: From `picks`.
        places: Place of each chosen row among the runs, from `places_of`.
        evaluation: Runs of the judged designs.
        scale: Of the QoC.
        units: [S] Labels of the fresh seeds, see `units_of`.
        limit: Largest share of runs with a collision; None for none.

    Returns:
        Value, deadline and F(Delta) of the choice; QoC, AUC, collisions and the paired difference to Co-design with
        their 95 % intervals; `within_limit`, whether even the upper end of the collision share keeps the limit; and
        with `unconstrained_`, what the policy takes without it.
    """
    shown = _Shown(evaluation, Scores.of(evaluation.runs["auc"].values, scale, units))
    chosen = [shown.settled(pick, places, limit) for pick in chosen]
    base = {pick.sweep: pick.row for pick in chosen if pick.policy == "Co-design"}
    table = []
    for pick in chosen:
        place, first, free = (None if row is None else places[row] for row in (pick.row, base[pick.sweep], pick.free))
        point = results.loc[pick.row] if pick.row is not None else dict.fromkeys(results.columns, np.nan)
        line: dict[str, Any] = {"sweep": pick.sweep, "policy": pick.policy}
        axes = axes_of(pick.sweep) if is_joint(pick.sweep) else ()  # of one alone the value says it
        line |= {name: point[name] for name in ("value", *axes, "deadline", "reliability", "reliability_se")}
        line |= {"qoc_selection": point["qoc"]} | shown.metrics(place) | shown.gap(place, first)
        line["within_limit"] = limit is None or bool(line["collision_high"] <= limit)
        line |= {"seeds": units.size, "at_edge": edges_of(results[results["sweep"] == pick.sweep], point, pick.policy)}
        if limit is not None:
            other = shown.metrics(free)
            if pick.free is not None:
                other |= {name: results.loc[pick.free, name] for name in ("value", *axes, "deadline")}
            line |= {f"unconstrained_{name}": other.get(name, np.nan) for name in (*_FREE, *axes)}
        if place is None:
            line["error"] = "every design diverged or failed"
        elif place in evaluation.failed:
            line["error"] = evaluation.failed[place]
        table.append(line)
    frame = pd.DataFrame(table)
    return (frame.fillna({"error": ""}) if "error" in frame else frame), chosen


class _Shown:
    """The judged designs, by their place."""

    def __init__(self, part: PartRuns, scores: Scores) -> None:
        self.runs: xr.Dataset = part.runs
        self.failed = part.failed
        self.scores = scores

    def settled(self, pick: Pick, places: Mapping[int, int], limit: float | None) -> Pick:
        """A choice that fresh seeds bear out, or what the policy takes without a limit."""
        if limit is None or pick.row is None:
            return pick
        borne_out = pick.kept and self.metrics(places[pick.row])["collision_high"] <= limit
        return pick if borne_out else pick._replace(row=pick.free, kept=False)

    def metrics(self, place: int | None) -> dict[str, Any]:
        """What is said of a design; NaN for none and for one of which runs are missing."""
        units = self.scores.units
        if place is None or place in self.failed:
            nothing = {"auc": np.nan, "auc_se": np.nan, "auc_low": np.nan, "auc_high": np.nan,
                       "collision_share": np.nan, "collision_low": np.nan, "collision_high": np.nan,
                       "min_distance": np.nan, "diverged_share": np.nan}  # fmt: skip
            return _qoc(self.scores[0], np.nan) | nothing
        costs = self.runs["auc"].values[place].astype(np.float64).mean(axis=-1)
        cost = estimate(costs, units=units)
        hits = collision_share(self.runs["collided"].values[place], self.runs.sizes["robot"], units,
                               self.scores.values[place])  # fmt: skip
        return _qoc(self.scores[place], 1.0) | {
            "auc": cost.mean, "auc_se": cost.se, "auc_low": cost.low, "auc_high": cost.high,
            "collision_share": hits.mean, "collision_low": hits.low, "collision_high": hits.high,
            "min_distance": float(self.runs["min_distance"].values[place].min()),
            "diverged_share": np.mean(~np.isfinite(costs)),
        }  # fmt: skip

    def gap(self, place: int | None, base: int | None) -> dict[str, float]:
        """Difference of one design to another on the same seeds."""
        bad = any(each is None or each in self.failed for each in (place, base))
        gap = self.scores[0] if bad else self.scores[place] - self.scores[base]
        return {name: np.nan if bad else value for name, value in gap.mean().columns("difference").items()}


def _qoc(scores: Scores, factor: float) -> dict[str, float]:
    return {name: factor * value for name, value in scores.mean().columns("qoc").items()}
