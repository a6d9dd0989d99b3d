"""The work that all baselines share: many runs of the closed loop, as plain arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

__all__ = ["DESIGN", "MIN_DISTANCE", "Unavailable", "Work", "make_work", "reference_path", "reference_share"]

# Floor of d_ij (m), so that coincident robots give finite numbers.
MIN_DISTANCE = 1e-6

# Parameters of a design and their defaults (model, section 1).
DESIGN = {"kappa": 2.0, "eta": 0.6, "gamma": 2.0, "c_miss": 0.2, "v_max": 0.7, "omega_max": 1.4, "d_safe": 0.5}


class Unavailable(RuntimeError):  # noqa: N818
    """A baseline that cannot run here; the message says what is missing."""


@dataclass(frozen=True, eq=False)
class Work:
    """L independent runs ("lanes") of N robots over P ticks; floats are stored as float32.

    Raises:
        ValueError: A shape, a value or an index that makes no run; also a robot that starts on the reference.
    """

    kappa: np.ndarray  # [L] 1/s
    eta: np.ndarray  # [L]
    gamma: np.ndarray  # [L] 1/s
    c_miss: np.ndarray  # [L] m/s
    v_max: np.ndarray  # [L] m/s
    omega_max: np.ndarray  # [L] rad/s
    d_safe: np.ndarray  # [L] m
    deadline: np.ndarray  # [L] s
    seed: np.ndarray  # [L] row of loop_times and start
    loop_times: np.ndarray  # [S, P, N] s, inf where lost
    start: np.ndarray  # [S, N, 3] m, m, rad
    tau: float
    horizon: float = 30.0
    goal: tuple[float, float] = (2.0, 0.0)
    weights: tuple[float, float] = (1.0, 1.0)
    reference_kappa: float = 2.0
    reference_v_max: float = 0.7

    def __post_init__(self) -> None:
        for name in (*DESIGN, "deadline", "loop_times", "start"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.float32))
        object.__setattr__(self, "seed", np.ascontiguousarray(self.seed, np.int32))
        self._check()

    def _check(self) -> None:
        _expect("seed", self.seed.ndim == 1 and self.seed.size > 0, "one index per lane, at least one lane")
        for name in (*DESIGN, "deadline"):
            _expect(name, getattr(self, name).shape == self.seed.shape, f"{self.seed.shape}, the shape of seed")
        ticks = round(self.horizon / self.tau)
        _expect("horizon", math.isclose(ticks * self.tau, self.horizon, rel_tol=1e-9), "a multiple of tau")
        _expect("start", self.start.ndim == 3 and self.start.shape[2] == 3, "the shape [S, N, 3]")
        seeds, robots, _ = self.start.shape
        _expect("loop_times", self.loop_times.shape == (seeds, ticks, robots), f"the shape {(seeds, ticks, robots)}")
        _expect("loop_times", bool(np.all(self.loop_times >= 0)), "delays of 0 or more, inf where lost")
        _expect("seed", bool(np.all((self.seed >= 0) & (self.seed < seeds))), f"rows below {seeds}")
        _expect("deadline", bool(np.all((self.deadline >= 0) & np.isfinite(self.deadline))), "finite, 0 or more")
        off = self.start[..., :2] - self.start[..., :2].mean(axis=1, keepdims=True)
        _expect("start", bool(np.all(np.any(off != 0, axis=-1))), "no robot on the reference (the centroid)")

    @property
    def num_lanes(self) -> int:
        """L."""
        return self.seed.shape[0]

    @property
    def num_ticks(self) -> int:
        """P."""
        return self.loop_times.shape[1]

    @property
    def num_robots(self) -> int:
        """N."""
        return self.loop_times.shape[2]

    @property
    def robot_steps(self) -> int:
        """L N P, what a wall time is divided by."""
        return self.num_lanes * self.num_robots * self.num_ticks

    @cached_property
    def change(self) -> tuple[np.ndarray, np.ndarray]:
        """When commands take effect: `lag` [L] int32 and `rest` [L] float32 (s), deadline = lag tau + rest.

        In tick p the command of tick p - lag takes effect at t_p + rest. The rest is in (0, tau], so that a deadline of
        k tau is lag k - 1 and a whole period: in force just before the controller samples (model, section 4). Only a
        deadline of 0 has rest 0: in force right after it.
        """
        ratio = self.deadline.astype(np.float64) / self.tau
        nearest = np.round(ratio)
        aligned = np.abs(ratio - nearest) <= 1e-6 * np.maximum(ratio, 1.0)
        lag = np.maximum(np.where(aligned, nearest - 1, np.floor(ratio)), 0)
        rest = np.where(aligned, np.minimum(nearest, 1) * self.tau, self.deadline - lag * self.tau)
        return np.minimum(lag, self.num_ticks).astype(np.int32), rest.astype(np.float32)

    @cached_property
    def mid_tick(self) -> bool:
        """Whether any command takes effect inside a tick or at its beginning, so that a tick can need two arcs."""
        return bool(np.any(self.change[1] != np.float32(self.tau)))


def reference_share(work: Work) -> np.ndarray:
    """|p̄(t_p) - p*| / |p̄(0) - p*|, [S, P+1] float32: at the cap, then exponential (model, section 5)."""
    length = np.linalg.norm(_centroid(work) - work.goal, axis=-1)[:, None]
    knee = np.minimum(work.reference_v_max / work.reference_kappa, length)
    time = np.arange(work.num_ticks + 1) * work.tau
    at_cap = (length - knee) / work.reference_v_max
    left = np.where(
        time < at_cap,
        length - work.reference_v_max * time,
        knee * np.exp(-work.reference_kappa * np.maximum(time - at_cap, 0.0)),
    )
    return (left / np.where(length > 0, length, 1.0)).astype(np.float32)


def reference_path(work: Work) -> np.ndarray:
    """p̄(t_p), [S, P+1, 2] float32 (m)."""
    offset = (_centroid(work) - work.goal).astype(np.float32)
    return np.asarray(work.goal, np.float32) + reference_share(work)[..., None] * offset[:, None]


def make_work(
    num_designs: int,
    num_seeds: int,
    deadlines: Sequence[float],
    tau: float = 0.01,
    *,
    horizon: float = 30.0,
    num_robots: int = 2,
    random_seed: int = 0,
) -> Work:
    """Every design with every seed at every deadline; a lane each, deadline slowest, seed fastest.

    Designs are drawn within a fifth of the defaults, loop times from the paper's TruncNormal(0.2, 0.05), starts around
    the defaults (for N != 2: on a circle through them) with the jitter of model, section 1. The same arguments give the
    same work.
    """
    rng = np.random.default_rng(random_seed)
    designs = {name: value * rng.uniform(0.8, 1.2, num_designs) for name, value in DESIGN.items()}
    loop_times = rng.normal(0.2, 0.05, (num_seeds, round(horizon / tau), num_robots))
    while (negative := loop_times < 0).any():
        loop_times[negative] = rng.normal(0.2, 0.05, np.count_nonzero(negative))
    angle = 2 * np.pi * np.arange(num_robots) / num_robots - np.pi / 2
    heading = np.where(np.arange(num_robots) == 0, 0.3, 0.0)
    start = np.stack([-2 + 1.5 * np.cos(angle), 1.5 * np.sin(angle), heading], axis=-1)
    start = start + rng.normal(0.0, 0.1, (num_seeds, num_robots, 3))
    d, g, s = (a.ravel() for a in np.indices((len(deadlines), num_designs, num_seeds)))
    lanes = {name: values[g] for name, values in designs.items()}
    deadline = np.asarray(deadlines)[d]
    return Work(**lanes, deadline=deadline, seed=s, loop_times=loop_times, start=start, tau=tau, horizon=horizon)


def _centroid(work: Work) -> np.ndarray:
    """Where the reference starts, [S, 2] float64."""
    return work.start[..., :2].mean(axis=1, dtype=np.float64)


def _expect(name: str, holds: bool, expected: str) -> None:
    if not holds:
        raise ValueError(f"Work.{name}: expected {expected}")
