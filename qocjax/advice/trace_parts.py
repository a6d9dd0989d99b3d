"""Another part of a trace as a change of its own: the stretch on which a design does worst."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qocjax.network import Reliability
from qocjax.network.trace import replayed_trace, with_replayed
from qocjax.scenario import Design
from qocjax.search.objective import Objective
from qocjax.statistics.scores import Scored, Scores, unpaired_scores
from qocjax.statistics.units import judged_apart, rows_of_stretch, seeds_in
from qocjax.study.reliability import reliability_of

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["WORST_PART", "WorstPart", "worst_part", "worst_stretch"]

WORST_PART = "worst part of the trace"


@dataclass(frozen=True)
class WorstPart:
    """Designs on the stretch that is worst for the first of them."""

    runs: xr.Dataset
    scores: Scores  # [G, S] each seed counts for itself: a replay of this stretch
    change: Scored  # of the QoC of the first, to that over all stretches
    reliability: Reliability  # at its deadline, of the rows of the stretch


def worst_stretch(scores: Scores) -> np.ndarray:
    """The smallest of the mean QoC on each stretch, of designs [G]."""
    units = np.arange(scores.values.shape[-1]) if scores.units is None else scores.units
    means = [scores.values[:, units == unit].mean(axis=1) for unit in np.unique(units)]
    return np.min(means, axis=0)


def worst_part(objective: Objective, scores: Scores, designs: Design) -> WorstPart | None:
    """The stretch of a trace that is worst for the first of some designs, on seeds that did not tell which it is.

    The least of some means is too low by the luck of its seeds; so further seeds of the worst stretch judge it, as many
    as there are of all. Intervals are those of replays of this one stretch: how others would differ it cannot say.

    Args:
        objective: The setting.
        scores: Of the designs, [G, S], on stretches that chose nothing.
        designs: [G], of one tau.

    Returns:
        None where the network is no trace, or one too short to be judged on other stretches than those that chose.
    """
    network, horizon, units = objective.network, objective.scenario.horizon, scores.units
    trace = replayed_trace(network)
    if units is None or trace is None or not judged_apart(network, horizon, designs.tau):
        return None
    known = np.unique(units)
    worst = int(known[np.argmin([scores.values[0, units == unit].mean() for unit in known])])
    count = scores.values.shape[-1]
    runs = objective.runs(designs, seeds_in(network, objective.key, worst, count, horizon, designs.tau))
    alone = Scores.of(runs["auc"].values, objective.scale)
    change = unpaired_scores(alone[0], replace(scores[0], units=None))
    first, end = rows_of_stretch(trace, worst, horizon, designs.tau)
    part = with_replayed(network, replace(trace, delays=np.asarray(trace.delays)[first:end]))
    deadline, tau = (float(np.asarray(values)[0]) for values in (designs.deadline, designs.tau))
    return WorstPart(runs, alone, change, reliability_of(part, objective.scenario, deadline, tau))
