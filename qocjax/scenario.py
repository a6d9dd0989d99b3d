"""What is simulated: the scenario (robots, goal, horizon, yardstick) and the design (what one may choose)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import jax
import numpy as np
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.robots import Robot, Unicycle
from qocjax.tunables import DESIGN

__all__ = ["NORMALISERS", "REFERENCES", "Design", "Scenario", "num_ticks"]

REFERENCES = ("nominal", "follow", "uncapped")
NORMALISERS = ("initial_disagreement", "goal_distance")

# Comparisons of times allow this much rounding, relative to one sampling period or to the deadline.
TIME_TOLERANCE = 1e-6


MOST_TICKS = 10**8  # of a run; 28 hours at a millisecond


def num_ticks(horizon: float, tau: float) -> int:
    """Number of sampling instants P in the horizon; the last interval is shorter where tau does not divide it.

    Raises:
        ValueError: None fits, or more than any run has.
    """
    ratio = float(horizon) / float(tau)
    if not TIME_TOLERANCE < ratio:
        raise ValueError(f"tau: got {tau:g}, expected at most the horizon, {horizon:g} s")
    if not ratio <= MOST_TICKS:
        raise ValueError(f"horizon, tau: got {horizon:g} s by {tau:g} s, {ratio:.3g} sampling instants, expected "
                         f"at most {MOST_TICKS:.0e}: a longer tau or a shorter horizon")  # fmt: skip
    return int(np.ceil(ratio - TIME_TOLERANCE))


T = TypeVar("T")


def _pytree(cls: type[T]) -> type[T]:
    """Registers a dataclass whose arguments are checked as a pytree whose leaves are not.

    JAX rebuilds pytrees with gradients, axes or masks as leaves, which may be negative or no numbers at all.
    """
    data = [item.name for item in fields(cls) if not item.metadata.get("static")]  # type: ignore[arg-type]
    static = [item.name for item in fields(cls) if item.metadata.get("static")]  # type: ignore[arg-type]

    def flatten(value: T) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return tuple(getattr(value, name) for name in data), tuple(getattr(value, name) for name in static)

    def flatten_with_keys(value: T) -> tuple[list[tuple[Any, Any]], tuple[Any, ...]]:
        leaves, rest = flatten(value)
        return [(jax.tree_util.GetAttrKey(name), leaf) for name, leaf in zip(data, leaves, strict=True)], rest

    def unflatten(rest: tuple[Any, ...], leaves: Iterable[Any]) -> T:
        value = object.__new__(cls)
        for name, leaf in zip((*data, *static), (*leaves, *rest), strict=True):
            object.__setattr__(value, name, leaf)
        return value

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


@_pytree
@dataclass(frozen=True)
class Scenario:
    """The robots, where they go, and the yardstick that a run is judged by (model, sections 1 and 5).

    Attributes:
        start: [N, 3] start poses (m, m, rad).
        goal: [2] common destination p*, or [N, 2] one per robot (m).
        horizon: Simulated time T (s).
        reference: `nominal` (the scenario's kappa and speed cap, fixed while a design is swept), `follow` (the
            design's own) or `uncapped` (nominal kappa, no cap).
        nominal_kappa: Goal gain of the nominal reference (1/s).
        nominal_v_max: Speed cap of the nominal reference (m/s).
        reference_per_robot: One reference from each robot's start instead of one from their centroid.
        normaliser: `initial_disagreement` (|delta_i(0)|²_W) or `goal_distance` (|p_i(0) - p*|²_W).
        weights: [2] axis weights (w_x, w_y) of W.
        start_jitter: Standard deviation of the start position per axis (m) and of the heading (rad), drawn anew for
            each Monte Carlo seed; (0, 0) switches it off.
        robot_radius: Two robots closer than two radii count as a collision (m).
        robot: What kind of robot they are.
    """

    start: ArrayLike = field(default_factory=lambda: np.array([[-2.0, -1.5, 0.3], [-2.0, 1.5, 0.0]]))
    goal: ArrayLike = field(default_factory=lambda: np.array([2.0, 0.0]))
    horizon: float = field(default=30.0, metadata={"static": True})
    reference: str = field(default="nominal", metadata={"static": True})
    nominal_kappa: ArrayLike = 2.0
    nominal_v_max: ArrayLike = 0.7
    reference_per_robot: bool = field(default=False, metadata={"static": True})
    normaliser: str = field(default="initial_disagreement", metadata={"static": True})
    weights: ArrayLike = field(default_factory=lambda: np.ones(2))
    start_jitter: tuple[float, float] = field(default=(0.1, 0.1), metadata={"static": True})
    robot_radius: ArrayLike = 0.105
    robot: Robot = field(default_factory=Unicycle)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "start", _checks.numbers("start", self.start, (None, 3)))
        if _checks.is_concrete(self.start) and np.shape(self.start)[0] < 1:
            raise ValueError("start: got no robot, expected [N, 3] start poses with N >= 1")
        set_(self, "goal", _checks.numbers("goal", self.goal))
        if _checks.is_concrete(self.goal) and np.shape(self.goal) not in ((2,), (np.shape(self.start)[0], 2)):
            raise ValueError(f"goal: got shape {np.shape(self.goal)}, expected (2,) or one goal per robot (N, 2)")
        set_(self, "horizon", float(_checks.bounded("horizon", self.horizon, above=0, shape=())))
        set_(self, "weights", _checks.numbers("weights", self.weights, (2,)))
        set_(self, "start_jitter", tuple(float(v) for v in _checks.numbers("start_jitter", self.start_jitter, (2,))))
        _checks.bounded("start_jitter", np.asarray(self.start_jitter), least=0)
        _checks.bounded("weights", self.weights, above=0)
        for name in ("nominal_kappa", "nominal_v_max", "robot_radius"):
            _checks.bounded(name, getattr(self, name), above=0, shape=())
        if not isinstance(self.robot, Robot) or jax.tree_util.all_leaves([self.robot]):
            raise TypeError(
                f"robot: got {self.robot!r}, expected a Robot that is registered as a pytree, as Unicycle()"
            )
        self.robot.check()
        if not isinstance(self.reference_per_robot, (bool, np.bool_)):
            raise TypeError(f"reference_per_robot: got {self.reference_per_robot!r}, expected True or False")
        _checks.choice("reference", self.reference, REFERENCES)
        _checks.choice("normaliser", self.normaliser, NORMALISERS)
        if not self.reference_per_robot and _checks.is_concrete(self.goal) and np.ndim(self.goal) == 2:
            if not np.all(np.asarray(self.goal) == np.asarray(self.goal)[0]):
                raise ValueError("goal: got different goals per robot with one reference for the group, "
                                 "expected reference_per_robot=True")  # fmt: skip

    @property
    def num_robots(self) -> int:
        """N."""
        return np.shape(self.start)[0]


@_pytree
@dataclass(frozen=True)
class Design:
    """What one may choose: the parameters Theta of the paper with the deadline (model, section 1).

    Each value is a number, or an array [G] for G designs at once. Defaults are the paper's, and for the deadline one in
    the middle of its axis.

    Attributes:
        v_max: Speed cap (m/s).
        omega_max: Turn rate cap (rad/s).
        eta: Repulsion gain.
        kappa: Goal gain (1/s).
        gamma: Heading gain (1/s).
        c_miss: Staleness penalty (m/s).
        d_safe: Nominal safety distance (m).
        tau: Sampling period of the loop (s).
        deadline: Loop-completion deadline Delta (s).
        others: Values of what else robot, controller, loop or network declare or configure, by name in the
            configuration, such as `controller.mppi.temperature`; see `qocjax.tunables`.
    """

    v_max: ArrayLike = 0.7
    omega_max: ArrayLike = 1.4
    eta: ArrayLike = 0.6
    kappa: ArrayLike = 2.0
    gamma: ArrayLike = 2.0
    c_miss: ArrayLike = 0.2
    d_safe: ArrayLike = 0.5
    tau: ArrayLike = 0.01
    deadline: ArrayLike = 0.3
    others: Mapping[str, ArrayLike] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in DESIGN:
            positive = name in ("tau", "d_safe", "v_max", "omega_max")
            limit: dict[str, Any] = {"above": 0} if positive else {"least": 0}
            object.__setattr__(self, name, _checks.bounded(name, getattr(self, name), **limit))
        kept = {name: _checks.numbers(name, value) for name, value in dict(self.others).items()}
        for name in kept:
            if name in DESIGN or not isinstance(name, str):
                raise ValueError(f"others: got {name!r}, expected a name beside {', '.join(DESIGN)}")
        object.__setattr__(self, "others", kept)

    @classmethod
    def of(cls, values: Mapping[str, ArrayLike]) -> Design:
        """The design of values by name, `others` among them."""
        own = {name: value for name, value in values.items() if name in DESIGN}
        return cls(**own, others={name: value for name, value in values.items() if name not in DESIGN})

    @classmethod
    def checked(cls, values: Mapping[str, Any]) -> Design:
        """The design of values that were checked before, as they are: a search makes one for each batch."""
        design = object.__new__(cls)
        for name in DESIGN:
            object.__setattr__(design, name, values[name])
        object.__setattr__(design, "others", {name: value for name, value in values.items() if name not in DESIGN})
        return design

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all its values."""
        return (*DESIGN, *self.others)

    def values(self) -> dict[str, Any]:
        """All its values by name, those of `others` last."""
        return {name: getattr(self, name) for name in DESIGN} | dict(self.others)

    def having(self, values: Mapping[str, Any]) -> Design:
        """The design with some values, by name, in place of its own."""
        return Design.of(self.values() | dict(values))

    def at(self, places: Any) -> Design:
        """Some of the designs [G]."""
        own = self.values()
        shape = np.broadcast_shapes(*(np.shape(value) for value in own.values()))
        return Design.of({name: np.broadcast_to(value, shape)[places] for name, value in own.items()})


def check_times(scenario: Scenario, tau: ArrayLike, deadline: ArrayLike | None = None) -> None:
    """Checks that every sampling period, and where given every deadline, fits into the horizon (s).

    Raises:
        ValueError: One is longer: no second sample, or no command, would come within it.
    """
    _checks.bounded("tau", tau, above=0, most=scenario.horizon)
    if deadline is not None:
        _checks.bounded("deadline", deadline, most=scenario.horizon)
