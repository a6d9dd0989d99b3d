"""One run of a study again, with its trajectory."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from qocjax import _checks
from qocjax.batch.drawing import draw_seeds, loops_of
from qocjax.controllers import Controller
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario, check_times, num_ticks
from qocjax.single import Run, simulate

__all__ = ["replay"]


def replay(
    scenario: Scenario,
    design: Design,
    network: Network,
    seed: int,
    *,
    rules: Rules | None = None,
    key: int = 0,
    controller: Controller | None = None,
) -> Run:
    """Simulates one design with one seed of an evaluation: the same start and the same loop times.

    Args:
        scenario: As of the evaluation.
        design: One design; every value a number.
        network: As of the evaluation.
        seed: The Monte Carlo seed.
        rules: As of the evaluation.
        key: As of the evaluation.
        controller: As of the evaluation.
    """
    rules = rules or Rules()
    _checks.counts("seed", [seed])
    check_times(scenario, design.tau, design.deadline)
    tau = float(np.asarray(_checks.bounded("tau", design.tau, shape=())))
    ticks = num_ticks(scenario.horizon, tau)
    start, drawn, keys = draw_seeds(
        np.asarray(scenario.start, jnp.result_type(float)), scenario.start_jitter, network, np.array([seed]), key,
        ticks, tau,
    )  # fmt: skip
    times = loops_of(network, drawn, ticks, tau, float(np.asarray(design.deadline)))
    return simulate(
        replace(scenario, start=np.asarray(start)[0]),
        design,
        np.asarray(times)[0],
        rules.actuation,
        rules.hold,
        hold_timeout=rules.hold_timeout,
        hold_decay=rules.hold_decay,
        plan_length=rules.plan_length,
        controller=controller,
        key=jax.random.wrap_key_data(np.asarray(keys)[0]),
    )
