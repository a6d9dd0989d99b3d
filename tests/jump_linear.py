"""Mean cost of a linear loop under random loop times, in closed form: what the simulation of it must meet.

x' = Ax + Bu + w, u = -Kx(t_p). What chance does to a tick (a loop completes or not; which one is the newest) depends
on a mode that is a Markov chain, and given that it is linear in z = [x; the last commands; the one in force]. So
E[zz'; mode] obeys a linear recursion (a Markov jump linear system; Costa, Fragoso and Marques, 2005), and each tick
costs a linear function of it. Nothing here is shared with the package but the laws' CDFs: modes are written from the
rules, and the integrals over a piece are Gauss-Legendre sums.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from qocjax import Rules
from qocjax.network import GilbertElliott
from qocjax.plants import LinearPlant

OLDEST = {"hold": 5, "zero": 5, "timeout": 8, "decay": 24}  # ticks of age from which on nobody tells them apart


@dataclass(frozen=True)
class Loops:
    """Independent loop times with losses that are independent or those of a Gilbert-Elliott channel."""

    cdf: Callable[[float], float]  # of T_net in s, of a loop that is not lost
    loss: float | GilbertElliott = 0.0

    def channel(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Loss probability of each state, transition matrix, stationary shares."""
        if isinstance(self.loss, float):
            return np.array([self.loss]), np.ones((1, 1)), np.ones(1)
        g, b = self.loss.p_good_to_bad, self.loss.p_bad_to_good
        return np.array([self.loss.loss_good, self.loss.loss_bad]), np.array([[1 - g, g], [b, 1 - b]]), np.array(
            [b, g]
        ) / (g + b)  # fmt: skip


class Branch(NamedTuple):
    """One thing that may happen in a tick."""

    chance: float
    then: int  # mode
    change: int | None  # age in ticks of the command that takes effect, None for no change
    stop: bool  # the command in force becomes zero
    gains: tuple[float, float]  # before and after the change


class Piece(NamedTuple):
    motion: np.ndarray
    noise: np.ndarray
    cost: np.ndarray
    drift: float


def piece(plant: LinearPlant, h: float) -> Piece:
    a, b, q, r, w = (np.asarray(getattr(plant, name), float) for name in "abqrw")
    n, m = b.shape
    f = np.block([[a, b], [np.zeros((m, n + m))]])
    s = np.block([[q, np.zeros((n, m))], [np.zeros((m, n)), r]])
    at, weight = np.polynomial.legendre.leggauss(10)

    def integral(of: Callable[[float], np.ndarray], end: float) -> np.ndarray:
        return sum(0.5 * end * c * of(0.5 * end * (1 + t)) for t, c in zip(at, weight, strict=True))

    grown = lambda t: expm(a * t) @ w @ expm(a * t).T  # noqa: E731
    cost = integral(lambda t: expm(f * t).T @ s @ expm(f * t), h)
    drift = float(integral(lambda t: (h - t) * np.trace(q @ grown(t)), h))  # ∫_0^h tr(Q covariance(t)) dt
    return Piece(expm(f * h)[:n], integral(grown, h), cost, drift)


def periods(deadline: float, tau: float) -> tuple[int, float]:
    """Whole sampling periods of the deadline, and the rest."""
    whole = int(np.floor(deadline / tau + 1e-9))
    rest = deadline - whole * tau
    return whole, rest if rest > 1e-9 else 0.0


def modes_of(loops: Loops, rules: Rules, deadline: float, tau: float) -> tuple[list[list[Branch]], np.ndarray, float]:
    """What may happen in each mode, the chances of the modes before the first tick, and when changes take effect."""
    (lag, rest), oldest = periods(deadline, tau), OLDEST[rules.hold]
    assert lag < oldest
    if rules.actuation == "arrival":
        return _arrival(loops, rules, deadline, tau, lag + (rest > 0)), np.eye(oldest + 1)[0], 0.0
    if rules.actuation == "instant":
        lag, rest = 0, 0.0
    losses, moves, start = loops.channel()
    branches = []
    for mode in range(len(losses) * (oldest + 1)):  # state of the channel, age of the command in force at the last tick
        state, age = divmod(mode, oldest + 1)
        done = (1 - losses[state]) * loops.cdf(deadline)
        older = min(age + 1, oldest)
        here: list[Branch] = []
        for then, move in enumerate(moves[state]):
            before, after = _faded(rules, older, deadline, tau), _faded(rules, lag, deadline, tau)
            gains = (before, 1.0) if rest else (after, after)
            here.append(Branch(move * done, then * (oldest + 1) + lag, lag, False, gains))
            stop = rules.hold == "zero"
            here.append(Branch(move * (1 - done), then * (oldest + 1) + older, None, stop, (before, before)))
        branches.append(here)
    return branches, np.kron(start, np.eye(oldest + 1)[oldest]), rest


def _arrival(loops: Loops, rules: Rules, deadline: float, tau: float, most: int) -> list[list[Branch]]:
    """The mode is the age of the newest command that has arrived; those newer than it are known not to have."""
    assert isinstance(loops.loss, float)
    oldest = OLDEST[rules.hold]
    ends = np.array([loops.cdf(min(k * tau, deadline)) for k in range(most + 1)]) * (1 - loops.loss)
    by = np.diff(ends, prepend=0.0)  # chance that a loop arrives k ticks after its sample
    hazard = by / (1.0 - ends + by)
    branches = []
    for age in range(oldest + 1):
        here, left = [], 1.0
        for newest in range(min(age, most) + 1):
            gain = _faded(rules, newest, deadline, tau)
            here.append(Branch(left * hazard[newest], newest, newest, False, (gain, gain)))
            left *= 1 - hazard[newest]
        older = min(age + 1, oldest)
        gain = _faded(rules, older, deadline, tau)
        if rules.hold == "zero" and older > most:  # a newer loop has missed its deadline
            gain = 0.0
        branches.append([*here, Branch(left, older, None, False, (gain, gain))])
    return branches


def _faded(rules: Rules, age: int, deadline: float, tau: float) -> float:
    if rules.hold == "timeout":
        return float(age * tau <= rules.hold_timeout + 1e-9)
    return float(np.exp(-max(0.0, age * tau - deadline) / rules.hold_decay)) if rules.hold == "decay" else 1.0


class Closed(NamedTuple):
    """The recursion of second moments, E branches."""

    mode: np.ndarray  # [E] from
    then: np.ndarray  # [E] to
    chance: np.ndarray  # [E]
    step: np.ndarray  # [E, d, d] z to the next z
    noise: np.ndarray  # [E, n, n]
    cost: np.ndarray  # [E, d, d]
    drift: np.ndarray  # [E]
    start: np.ndarray  # chances of the modes before the first tick


def closed(plant: LinearPlant, loops: Loops, rules: Rules, deadline: float, tau: float) -> Closed:
    """Works out the recursion."""
    branches, start, rest = modes_of(loops, rules, deadline, tau)
    n, m = np.shape(plant.b)
    past = periods(deadline, tau)[0] + 2
    size = n + m * past + m
    parts = [piece(plant, rest), piece(plant, tau - rest)] if rest else [piece(plant, tau)]
    rows = np.eye(size)
    computed = np.vstack([-np.asarray(plant.k, float) @ rows[:n], rows[n : n + m * past]]).reshape(past + 1, m, size)

    @cache
    def linear(change: int | None, stop: bool, gains: tuple[float, float]) -> tuple[np.ndarray, ...]:
        held = rows[n + m * past :]
        after = np.zeros_like(held) if stop else held if change is None else computed[change]
        forces = [held * gains[0], after * gains[1]] if rest else [after * gains[0]]
        x, noise, cost, drift = rows[:n], np.zeros((n, n)), np.zeros((size, size)), 0.0
        for part, force in zip(parts, forces, strict=True):
            z = np.vstack([x, force])
            cost = cost + z.T @ part.cost @ z
            drift = drift + part.drift + np.trace(part.cost[:n, :n] @ noise)
            noise = part.motion[:, :n] @ noise @ part.motion[:, :n].T + part.noise
            x = part.motion @ z
        return np.vstack([x, *computed[:past], after]), noise, cost, np.asarray(drift)

    each = [(mode, branch) for mode, here in enumerate(branches) for branch in here if branch.chance > 0.0]
    maps = zip(*(linear(branch.change, branch.stop, branch.gains) for _, branch in each), strict=True)
    ends = ([mode for mode, _ in each], [branch.then for _, branch in each], [branch.chance for _, branch in each])
    return Closed(*(np.array(item) for item in ends), *(np.array(item) for item in maps), start)


def mean_cost(
    plant: LinearPlant, loops: Loops, rules: Rules, deadline: float, tau: float, ticks: int, start: np.ndarray
) -> float:
    """Mean of ∫ x'Qx + u'Ru dt per second over the first ticks, from the state `start`."""
    system, n = closed(plant, loops, rules, deadline, tau), len(start)
    share, total = system.start, 0.0
    moments = np.zeros((len(share), *system.step.shape[1:]))
    moments[:, :n, :n] = share[:, None, None] * np.outer(start, start)
    for _ in range(ticks):
        before, chances = moments[system.mode], system.chance * share[system.mode]
        total += np.sum(system.chance * np.sum(system.cost * before, axis=(1, 2))) + np.sum(chances * system.drift)
        after = system.chance[:, None, None] * (system.step @ before @ system.step.swapaxes(1, 2))
        after[:, :n, :n] += chances[:, None, None] * system.noise
        share, moments = np.zeros_like(share), np.zeros_like(moments)
        np.add.at(share, system.then, chances)
        np.add.at(moments, system.then, after)
    return float(total / (ticks * tau))


def stationary_cost(plant: LinearPlant, loops: Loops, rules: Rules, deadline: float, tau: float) -> float:
    """The same over all time: second moments that the recursion leaves as they are, from one linear system."""
    system, n = closed(plant, loops, rules, deadline, tau), np.shape(plant.a)[0]
    modes, size = len(system.start), system.step.shape[1]
    chances = np.zeros((modes, modes))
    np.add.at(chances, (system.then, system.mode), system.chance)
    share = np.linalg.lstsq(np.vstack([np.eye(modes) - chances, np.ones(modes)]), np.eye(modes + 1)[-1])[0]
    square = size * size
    recursion, added = np.zeros((modes, square, modes, square)), np.zeros((modes, size, size))
    for mode, then, chance, step, noise, *_ in zip(*system[:5], strict=True):
        recursion[then, :, mode, :] += chance * np.kron(step, step)
        added[then, :n, :n] += chance * share[mode] * noise
    flat = recursion.reshape(modes * square, modes * square)
    assert np.abs(np.linalg.eigvals(flat)).max() < 1.0  # stable in the mean square
    moments = np.linalg.solve(np.eye(len(flat)) - flat, added.ravel()).reshape(modes, size, size)
    of_state = np.sum(system.cost * moments[system.mode], axis=(1, 2))
    return float(np.sum(system.chance * (of_state + share[system.mode] * system.drift)) / tau)
