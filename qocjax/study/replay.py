"""One run of a study again, with its trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qocjax.batch.runner import jittered_start, seed_keys
from qocjax.network.interface import Network, loop_times
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario, num_ticks
from qocjax.simulate import Run, simulate

__all__ = ["replay"]


def replay(
    scenario: Scenario, design: Design, network: Network, seed: int, *, rules: Rules | None = None, key: int = 0
) -> Run:
    """Simulates one design with one seed of an evaluation: the same start and the same loop times.

    Args:
        scenario: As of the evaluation.
        design: One design; every value a number.
        network: As of the evaluation.
        seed: The Monte Carlo seed.
        rules: As of the evaluation.
        key: As of the evaluation.
    """
    rules = rules or Rules()
    jitter_key, network_key = seed_keys(key, np.array([seed]))
    start = jittered_start(scenario, jitter_key)[0]
    tau = float(np.asarray(design.tau))
    ticks = num_ticks(scenario.horizon, tau)
    times = loop_times(network, network_key, ticks, scenario.num_robots, tau)[0]
    return simulate(
        replace(scenario, start=np.asarray(start)),
        design,
        np.asarray(times),
        rules.actuation,
        rules.hold,
        hold_timeout=rules.hold_timeout,
        hold_decay=rules.hold_decay,
    )
