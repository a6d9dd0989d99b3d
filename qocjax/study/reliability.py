"""F(Delta) of designs: what a network completes under the load that each one puts on it (model, sections 4, 12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from qocjax.network.interface import Load, Network, Reliability
from qocjax.scenario import Scenario, num_ticks

__all__ = ["load_of", "reliability_of", "share_text"]


def load_of(scenario: Scenario, tau: float) -> Load:
    """What the robots of a scenario put on a network at one sampling period (s)."""
    return Load(num_ticks(scenario.horizon, float(tau)), scenario.num_robots, float(tau))


def reliability_of(network: Network, scenario: Scenario, deadline: ArrayLike, tau: ArrayLike) -> Reliability:
    """F(deadline) with its standard error.

    Args:
        network: Where loop times come from.
        scenario: Its robots and its horizon are the load.
        deadline: s, any shape.
        tau: s, broadcastable to the deadlines.
    """
    at, period = np.broadcast_arrays(np.asarray(deadline, np.float64), np.asarray(tau, np.float64))
    share, error = np.empty(at.shape), np.empty(at.shape)
    for each in np.unique(period):
        here = period == each
        share[here], error[here] = network.reliability(at[here], load_of(scenario, each))
    return Reliability(share, error)


def share_text(share: float, error: float, digits: int = 3) -> str:
    """F for a reader: with its standard error where it was estimated."""
    text = f"{share:.{digits}f}"
    return text if not error > 0 else f"{text} ± {max(error, 10.0**-digits):.{digits}f}"
