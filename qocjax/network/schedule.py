"""Which command is in force when, and how old it is: loop completion, actuation and hold (model, section 4).

All of it depends on the loop times, the deadline and the rules alone, not on the robots' state nor on their gains: so
it is computed once per seed and deadline, ahead of the closed loop, and shared by all designs.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax import _checks
from qocjax.network.completion import completes
from qocjax.scenario import TIME_TOLERANCE

__all__ = ["ACTUATIONS", "HOLDS", "Rules", "Schedule", "schedule", "split_deadline"]

ACTUATIONS = ("deadline", "arrival", "instant")
HOLDS = ("hold", "zero", "timeout", "decay", "buffer")


@dataclass(frozen=True)
class Rules:
    """How completed and missed loops act on the robot.

    Attributes:
        actuation: `deadline` (a command takes effect at exactly t_p + Delta), `arrival` (at the first sampling instant
            at or after its arrival) or `instant` (at t_p).
        hold: What a missed loop does: `hold` (the previous command stays, ZOH), `zero` (the robot stops), `timeout`
            (it stops once the age exceeds `hold_timeout`), `decay` (the command fades with its age) or `buffer` (each
            packet carries the next commands too: the newest packet's next one takes effect; see `qocjax.packets`).
        hold_timeout: For `timeout` (s).
        hold_decay: Time constant of `decay` (s).
        plan_length: M, commands of a packet, for `buffer`; else None.
    """

    actuation: str = "deadline"
    hold: str = "hold"
    hold_timeout: float = 0.5
    hold_decay: float = 0.5
    plan_length: int | None = None

    def __post_init__(self) -> None:
        _checks.choice("actuation", self.actuation, ACTUATIONS)
        _checks.choice("hold", self.hold, HOLDS)
        self._check_plan()
        for name in ("hold_timeout", "hold_decay"):  # kept as Python floats, so that rules hash
            value = _checks.bounded(name, getattr(self, name), above=0, shape=())
            object.__setattr__(self, name, float(np.asarray(value)))

    def check_single(self, why: str = "ROS's velocity messages carry one command") -> None:
        """For what sends one command at a time: a node of ROS, what is advised for one, a plant that is no robot.

        Args:
            why: Why it does, for the message.

        Raises:
            ValueError: Commands are plans.
        """
        if self.hold == "buffer":
            words = ", ".join(hold for hold in HOLDS if hold != "buffer")
            raise ValueError(f"hold: got 'buffer', expected one of {words}: {why}")

    def _check_plan(self) -> None:
        if self.hold != "buffer":
            if self.plan_length is not None:
                raise ValueError(f"plan_length: got {self.plan_length!r} with hold {self.hold!r}, expected none: only "
                                 "'buffer' reads it")  # fmt: skip
            return
        if self.plan_length is None:
            raise ValueError("plan_length: got none with hold 'buffer', expected the number of commands in a packet")
        object.__setattr__(self, "plan_length", _checks.count("plan_length", self.plan_length))
        if self.actuation == "arrival":
            raise ValueError("actuation: got 'arrival' with hold 'buffer', expected 'deadline' or 'instant', as a plan "
                             "is made for one instant")  # fmt: skip


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Schedule:
    """What the network does to each robot, tick by tick; `*B` is any batch, usually the seeds.

    Within a tick the command may change once: at t_p right after the controller has sampled, or, where a deadline is no
    multiple of tau, at t_p + `rest`. `fresh` says whether it does, `source` by which loop's command.
    """

    age: Array  # [P, N, *B] s, as the controller sees it at t_p
    fresh: Array  # [P, N, *B] bool
    source: Array  # [P, N, *B] loop (tick) whose command is in force after the change, -1 before the first
    completed: Array  # [P, N, *B] bool, loop p completes
    gain_start: Array | None  # [P, N, *B] factor on the command from t_p on; None where it is always 1
    gain_mid: Array | None  # [P, N, *B] factor from t_p + rest on; None without a change there, or where always 1


def split_deadline(deadline: Array | float, tau: Array | float) -> tuple[Array, Array]:
    """Whole sampling periods in a deadline and the rest (s); a multiple up to rounding has rest 0."""
    traced = isinstance(deadline, Array) or isinstance(tau, Array)
    xp = jnp if traced else np  # numbers known beforehand need no compiled program
    ratio = xp.asarray(deadline / tau)
    nearest = xp.round(ratio)
    aligned = xp.abs(ratio - nearest) <= _slack(ratio) * xp.maximum(ratio, 1.0)
    whole = xp.where(aligned, nearest, xp.floor(ratio))
    return whole.astype(xp.int32), xp.where(aligned, 0.0, deadline - whole * tau)


def schedule(
    loop_times: Array, deadline: Array | float, tau: Array | float, rules: Rules, mid_tick: bool | Array
) -> Schedule:
    """Works out the schedule of every robot from its loop times.

    Args:
        loop_times: [P, N, *B] T_net of the loop that starts at t_p (s), inf where lost.
        deadline: Delta (s).
        tau: Sampling period (s).
        rules: Actuation and hold.
        mid_tick: Whether commands take effect between sampling instants: actuation `deadline` with a rest.
    """
    completed = completes(loop_times, deadline)
    before, after = _newest_effective(loop_times, completed, deadline, tau, rules, mid_tick)
    source, previous = _running_max(jnp.maximum(before, after))
    seen = jnp.maximum(previous, before)
    tick = _ticks_like(source)
    age = (tick - jnp.maximum(seen, 0)) * tau
    at_start = jnp.where(mid_tick, previous, source)
    fresh = source > previous
    start, mid = _gains(completed, source, at_start, fresh, deadline, tau, rules, mid_tick)
    return Schedule(age, fresh, source, completed, start, mid)


def _newest_effective(
    loop_times: Array,
    completed: Array,
    deadline: Array | float,
    tau: Array | float,
    rules: Rules,
    mid_tick: bool | Array,
) -> tuple[Array, Array]:
    """Newest loop whose command takes effect in each tick, before and after the controller samples; -1 for none."""
    tick = _ticks_like(completed)
    own = jnp.where(completed, tick, -1)
    none = jnp.full_like(own, -1)
    if rules.actuation == "instant":
        return none, own
    if rules.actuation == "deadline":
        lag, _ = split_deadline(deadline, tau)
        due = _delayed(own, lag)
        seen_first = (lag > 0) & jnp.logical_not(mid_tick)
        return jnp.where(seen_first, due, -1), jnp.where(seen_first, -1, due)
    waited = jnp.where(completed, loop_times, 0.0) / tau
    lag_of = jnp.ceil(waited - _slack(waited) * jnp.maximum(waited, 1.0)).astype(jnp.int32)
    arrival = jnp.where(completed & (lag_of > 0), tick + lag_of, tick.shape[0])
    index = jnp.indices(own.shape, sparse=True)[1:]
    arrived = none.at[(arrival, *index)].max(own, mode="drop")
    return arrived, jnp.where(lag_of == 0, own, -1)


def _gains(
    completed: Array,
    source: Array,
    at_start: Array,
    fresh: Array,
    deadline: Array | float,
    tau: Array | float,
    rules: Rules,
    mid_tick: bool | Array,
) -> tuple[Array | None, Array | None]:
    """Factors on the command in force from t_p and, where commands take effect there, from t_p + rest on."""
    if rules.hold in ("hold", "buffer"):  # the commands of a packet, its end included, are the tick's business
        return None, None
    tick = _ticks_like(source)
    if rules.hold == "zero":
        missed, _ = _running_max(_missed_verdicts(completed, deadline, tau, rules))
        moving = (source >= missed).astype(jnp.result_type(tau, float))
        earlier = jnp.concatenate([jnp.ones_like(moving[:1]), moving[:-1]])
        return jnp.where(mid_tick, earlier, moving), moving
    age = (tick - jnp.maximum(at_start, 0)) * tau
    if rules.hold == "timeout":
        start = (age <= rules.hold_timeout * (1 + TIME_TOLERANCE)).astype(age.dtype)
    else:
        start = jnp.exp(-jnp.maximum(age - deadline, 0.0) / rules.hold_decay)
    return start, jnp.where(fresh & mid_tick, 1.0, start)


def _missed_verdicts(completed: Array, deadline: Array | float, tau: Array | float, rules: Rules) -> Array:
    """Newest loop known to be missed by each tick's change of command: at its deadline, or at once if `instant`."""
    missed = jnp.where(completed, -1, _ticks_like(completed))
    if rules.actuation == "instant":
        return missed
    lag, rest = split_deadline(deadline, tau)
    return _delayed(missed, lag + (rest > 0) if rules.actuation == "arrival" else lag)


def _ticks_like(a: Array) -> Array:
    """Tick numbers [P, 1, ...] of the rank of `a`."""
    return jnp.arange(a.shape[0], dtype=jnp.int32).reshape((-1,) + (1,) * (a.ndim - 1)) + jnp.zeros_like(a, jnp.int32)


def _delayed(a: Array, lag: Array) -> Array:
    """a[p - lag] at tick p, -1 before."""
    lag = jnp.minimum(lag, a.shape[0])
    return lax.dynamic_slice_in_dim(jnp.concatenate([jnp.full_like(a, -1), a]), a.shape[0] - lag, a.shape[0])


def _running_max(a: Array) -> tuple[Array, Array]:
    """Largest so far, at each tick and at the tick before it (-1 at the first)."""
    first = jnp.full(a.shape[1:], -1, a.dtype)
    _, (now, before) = lax.scan(lambda m, row: (jnp.maximum(m, row), (jnp.maximum(m, row), m)), first, a)
    return now, before


def _slack(like: Array) -> float:
    """Rounding allowance on a ratio of times: the model's, or what float32 needs."""
    return max(TIME_TOLERANCE, 8 * float(jnp.finfo(jnp.result_type(like, float)).eps))
