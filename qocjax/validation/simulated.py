"""AUC over configured delays from the simulator, with the paper's delay injection and any controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from qocjax import _checks
from qocjax.batch import evaluate
from qocjax.controllers import Controller
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.network.trace import replayed_trace
from qocjax.scenario import Design, Scenario
from qocjax.statistics.units import units_of
from qocjax.validation.curves import Curve

__all__ = ["simulated_curve"]


def simulated_curve(
    scenario: Scenario,
    design: Design,
    network: Network,
    delays: Sequence[float] | np.ndarray,
    seeds: Sequence[int],
    *,
    controller: Controller | None = None,
    rules: Rules | None = None,
    key: int = 0,
    source: str = "surrogate",
    progress: Callable[[int], None] | None = None,
) -> Curve:
    """Simulates a curve: each command is buffered until the configured delay and only then applied.

    That is the actuation `deadline` with the deadline phi (model, section 4; paper, "Validation methodology"). Curves
    of other controllers on the same seeds share start poses and loop times, so they can be compared in pairs.

    Args:
        scenario: Robots and yardstick.
        design: Numbers; its deadline is not read.
        network: Where loop times come from.
        delays: [D] configured delays phi (s), in any order.
        seeds: [S] Monte Carlo seeds.
        controller: As of `evaluate`; None for the surrogate law.
        rules: Hold; the actuation must be `deadline`.
        key: Root of all random numbers.
        source: What the curve is called.
        progress: Called with robot-steps done.

    Raises:
        ValueError: Another actuation, a delay twice, or a run that diverged.
    """
    rules = rules or Rules()
    if rules.actuation != "deadline":
        raise ValueError(f"actuation: got {rules.actuation!r}, expected 'deadline': a configured delay is injected by "
                         "applying each command when it has passed")  # fmt: skip
    axis = np.sort(np.asarray(_checks.bounded("delays", delays, least=0, shape=(None,)), np.float64))
    runs = evaluate(scenario, replace(design, deadline=axis), network, seeds, rules=rules, key=key, progress=progress,
                    controller=controller)  # fmt: skip
    auc = runs["auc"].values.astype(np.float64).mean(axis=-1)
    if not np.isfinite(auc).all():
        row, column = np.argwhere(~np.isfinite(auc))[0]
        raise ValueError(f"{source}: {np.count_nonzero(~np.isfinite(auc))} of {auc.size} runs diverged, the first at "
                         f"{1e3 * axis[row]:g} ms with seed {list(seeds)[column]}, expected a finite AUC")  # fmt: skip
    units = units_of(network, seeds, key, scenario.horizon, design.tau)
    return Curve.of_table(axis, auc, list(seeds), source, None if replayed_trace(network) is None else units.tolist())
