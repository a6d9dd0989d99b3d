"""Calibration: gains of the surrogate law with which its normalised curve follows measured ones (paper, future work).

The search is that of the joint co-design (`qocjax.search`), with another question: a point of the cube is a set
of gains, a look at it simulates the whole curve of every setting, and what is maximised is 100 less the RMSE on the
normalised scale. Where the measured curves have seeds, the surrogate is simulated on the same ones. Methods that follow
derivatives of single runs are left out: over 30 s their mean over seeds is of no use (experiments/README.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from qocjax import _checks
from qocjax.batch import evaluate
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.search import Measure, Problem, Space, find
from qocjax.search.objective import Objective
from qocjax.study.edges import at_bounds
from qocjax.validation.curves import Curve, normalised

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["BOUNDS", "FIT_METHODS", "Fit", "Setting", "fit"]

FIT_METHODS = ("random", "sobol", "cma_es")

BOUNDS: dict[str, tuple[float, float]] = {
    "eta": (0.0, 2.0), "d_safe": (0.1, 1.5), "kappa": (0.25, 8.0), "gamma": (0.25, 8.0),
}  # fmt: skip
"""Between what the gains are looked for; those of the tuner."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What a curve was measured in: the surrogate is simulated in the same.

    Attributes:
        name: For tables.
        scenario: Robots and yardstick.
        measured: E in this setting.
    """

    name: str
    scenario: Scenario
    measured: Curve


@dataclass(frozen=True)
class Fit:
    """Gains that were found."""

    design: Design  # numbers
    gains: dict[str, float]  # by name, those that were looked for
    method: str
    looks: int  # at a set of gains on one seed; each simulates every delay of every setting once
    rmse: float  # over the settings, where it was chosen among the best: flattered by the search
    at_edge: str = ""  # which bounds of the search the gains lie at


@dataclass(frozen=True)
class _Closeness(Measure):
    """100 less the RMSE of the normalised mean curves of AUC [..., S, 2, K]: S and E, the settings laid end to end."""

    delays: tuple[int, ...] = ()  # of each setting

    def __call__(self, scores: ArrayLike, axis: int = -1) -> np.ndarray:
        return 100.0 - self._distance(np.asarray(scores, np.float64).mean(axis=-3))

    def error(self, scores: ArrayLike) -> np.ndarray:
        """Standard error by the jackknife over the seeds of [S, 2, K]."""
        values = np.asarray(scores, np.float64)
        count = values.shape[-3]
        without = (values.sum(axis=-3, keepdims=True) - values) / (count - 1)
        return np.sqrt((count - 1) * self._distance(without).var(axis=-1))

    def _distance(self, means: np.ndarray) -> np.ndarray:
        parts = np.split(means, np.cumsum(self.delays)[:-1], axis=-1)
        squares = [_squares(part[..., 0, :], part[..., 1, :]) for part in parts]
        return np.sqrt(np.mean(np.concatenate(squares, axis=-1), axis=-1))


def _squares(simulated: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Squared differences of the normalised curves; the largest there are for one that diverged or is flat."""
    sound = np.isfinite(simulated).all(axis=-1, keepdims=True)
    sound &= np.ptp(np.where(np.isfinite(simulated), simulated, 0.0), axis=-1, keepdims=True) > 0
    ramp = np.arange(simulated.shape[-1], dtype=float)
    return np.where(sound, (normalised(np.where(sound, simulated, ramp)) - normalised(measured)) ** 2, 1e4)


@dataclass(frozen=True)
class _CurveProblem(Problem):
    """A look at gains: AUC at every delay of every setting, in place of a QoC."""

    settings: tuple[Setting, ...] = ()

    def simulate(self, designs: Design, seeds: range) -> tuple[np.ndarray, np.ndarray]:
        """AUC [G, S, 2, K] over the delays of all settings, S and E, and whether robots collided at any, [G, S]."""
        curves, collided = [], []
        for setting in self.settings:
            found, measured = self._runs(setting, designs, seeds)
            auc = found["auc"].values.astype(np.float64).mean(axis=-1)
            shape = (np.shape(designs.kappa)[0], setting.measured.delays.size, len(seeds))
            own = np.swapaxes(auc.reshape(shape), 1, 2)
            curves.append(np.stack([own, np.broadcast_to(measured.T, own.shape)], axis=2))
            collided.append(found["collided"].values.astype(bool).reshape(shape).any(axis=1))
        return np.concatenate(curves, axis=-1), np.any(collided, axis=0)

    def _runs(self, setting: Setting, designs: Design, seeds: range) -> tuple[xr.Dataset, np.ndarray]:
        """Runs of every design at every delay, and E by seed, [D, S]; of E's own seeds where it has some."""
        measured, goal = setting.measured, self.objective
        numbers = list(seeds)
        if measured.seeds is None:
            values = np.tile(measured.mean[:, None], (1, len(numbers)))
        else:
            places = np.array(numbers) % len(measured.seeds)
            numbers, values = [measured.seeds[k] for k in places], np.stack(measured.values)[:, places]
        axis, size = measured.delays, np.shape(designs.kappa)[0]
        crossed = {name: np.repeat(np.asarray(value, float), axis.size) for name, value in designs.values().items()}
        every = Design.of(crossed | {"deadline": np.tile(axis, size)})
        distinct, back = np.unique(numbers, return_inverse=True)
        runs = evaluate(setting.scenario, every, goal.network, distinct.tolist(), rules=goal.rules, key=goal.key)
        goal.simulations += runs.sizes["design"] * runs.sizes["seed"]
        return runs.isel(seed=back), values


def fit(
    settings: Sequence[Setting],
    baseline: Design,
    network: Network,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    *,
    rules: Rules | None = None,
    key: int = 0,
    method: str = "cma_es",
    budget: int = 6000,
    repetition: int = 0,
) -> Fit:
    """Looks for one set of gains with which the surrogate follows the measured curves of all settings.

    Each look takes as many seeds as the measured curves have, up to 32: the same ones, so that it compares in pairs;
    curves without seeds are held against seeds of the search's own, new ones at every look. The measured curves are
    read as they are: give those of the fit seeds alone.

    Args:
        settings: What to follow.
        baseline: Numbers; what is not looked for stays.
        network: Where loop times come from.
        bounds: Of the gains that are looked for; `BOUNDS` by default.
        rules: Hold; the actuation is that of the delay injection, `deadline`.
        key: Root of all random numbers.
        method: One of `FIT_METHODS`.
        budget: Looks at a set of gains on one seed, 768 of them for the choice.
        repetition: Number of this search; each has its own random numbers and seeds.

    Raises:
        ValueError: No setting, an unknown method, a bad bound, or too small a budget.
    """
    if not settings:
        raise ValueError("settings: got none, expected at least one")
    _checks.choice("method", method, FIT_METHODS)
    for each in settings:
        normalised(each.measured.mean)  # raises for a curve without a scale
    space = Space(dict(bounds or BOUNDS), (float(np.asarray(baseline.tau)),), (0.0,), True, baseline)
    objective = Objective(settings[0].scenario, network, QocScale(1.0, 1.0), rules or Rules(), key)
    problem = _CurveProblem(
        objective,
        space,
        settings=tuple(settings),
        measure=_Closeness(delays=tuple(each.measured.delays.size for each in settings)),
    )
    known = [len(each.measured.seeds) for each in settings if each.measured.seeds is not None]
    found = find(problem, method, budget, repetition=repetition, key=key, block=min(max(known, default=8), 32))
    gains = {name: float(np.asarray(found.design.values()[name])[0]) for name in space.bounds}
    return Fit(baseline.having(gains), gains, method, found.spent, 100.0 - found.fitness,
               at_bounds(gains, space.bounds, {}))  # fmt: skip
