"""How a grid of designs x seeds is cut into batches: the layout of the batch lives here alone.

All runs of a batch share tau and the deadline, so that one row of the command buffer is due for all of them and nothing
is gathered per run. Arrays are [N, designs, seeds] with the seeds last: what depends on the seed alone (loop times,
schedule, start, reference) is stored once and read along the vector lanes, what depends on the design is one number per
row of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from qocjax.network.interface import general_length
from qocjax.network.schedule import Rules, split_deadline
from qocjax.scenario import num_ticks

__all__ = ["LANES", "WIDEST", "Batch", "Group", "batches_of", "groups_of"]

# Seeds of one batch: whole vector registers, and few enough that their schedule stays in cache beside many designs.
LANES = 32

# Seeds of a batch of few designs, which would else be over before it was worth its call, and the most loops of all of
# them: beyond, memory comes from the system anew for each batch, which takes longer than the batch.
WIDEST = 4 * LANES
_WIDE = (WIDEST, 2 * LANES)
_MOST_LOOPS = 1 << 19

# Robot-steps at one tau from which a program made for it saves more time than its compilation takes. Below, designs of
# all sampling periods run on a few general programs, whose ticks beyond the horizon have no length.
_WORTH_A_PROGRAM = 1e8

# Ticks of the shortest general program: where several sampling periods share it, or others may want it next, and where
# all designs have one and so much work, in robot-steps, that a program of their own length pays.
_SHARED, _SHORTEST, _WORTH_A_LENGTH = 2048, 256, 4e6

_FEW_SLOTS = 16  # of the command buffer, up to which a power of two costs nothing and serves many deadlines


@dataclass(frozen=True)
class Group:
    """All designs of one sampling period and deadline."""

    tau: float
    longest_period: float  # the largest tau that the program serves
    deadline: float
    ticks: int  # P, loops in the horizon
    lag: int  # whole sampling periods until a command takes effect
    length: int  # ticks of the program
    mid_tick: bool | None  # whether commands take effect between sampling instants; None if the program is to see
    slots: int  # capacity of the program's command buffer: for the longest deadline that it serves
    designs: np.ndarray  # indices into the grid
    alone: bool  # whether the whole grid has this one sampling period
    general: bool = False  # whether the program serves other runs too, of any length up to its own


@dataclass(frozen=True)
class Batch:
    """One call of the compiled loop; short ones are filled up by repeating the last index, to keep the shape."""

    group: Group
    designs: np.ndarray  # [rows] indices into the grid
    seeds: np.ndarray  # [lanes] indices into the seeds
    num_designs: int  # of the rows, how many are real
    num_seeds: int  # of the lanes, how many are real


def groups_of(
    tau: np.ndarray, deadline: np.ndarray, horizon: float, rules: Rules, runs_each: int, general: bool = True
) -> list[Group]:
    """Groups the designs of a grid by sampling period, then deadline.

    Args:
        tau: [G] s.
        deadline: [G] s.
        horizon: T (s).
        rules: Actuation and hold.
        runs_each: Robots x seeds of each design, to weigh the work.
        general: Whether sampling periods with little work may share general programs.
    """
    groups, periods = [], np.unique(tau)
    for period in periods:
        limits, ticks = np.unique(deadline[tau == period]), num_ticks(horizon, period)
        splits = [split_deadline(np.float64(limit), np.float64(period)) for limit in limits]
        slots = 1 if rules.actuation == "instant" else _slots(min(max(int(lag) for lag, _ in splits), ticks))
        for limit, (lag, rest) in zip(limits, splits, strict=True):
            chosen = np.flatnonzero((tau == period) & (deadline == limit))
            inside = rules.actuation == "deadline" and float(rest) > 0
            waits = 0 if rules.actuation == "instant" else min(int(lag), ticks)
            groups.append(
                Group(
                    float(period), float(period), float(limit), ticks, waits, ticks, inside, slots, chosen,
                    alone=periods.size == 1,
                )
            )  # fmt: skip
    return _sharing(groups, rules, runs_each) if general else groups


def _sharing(groups: list[Group], rules: Rules, runs_each: int) -> list[Group]:
    """Puts the groups of sampling periods with little work on general programs."""
    designs = Counter[float]()
    for group in groups:
        designs[group.tau] += len(group.designs)
    worth = designs.total() * runs_each * _SHARED > _WORTH_A_LENGTH
    least = _SHORTEST if worth and groups[0].alone else _SHARED
    lengths = {group.tau: general_length(group.ticks, least) for group in groups}
    little = {tau for tau, length in lengths.items() if designs[tau] * runs_each * length < _WORTH_A_PROGRAM}
    longest = max(little, default=0.0)
    slots = _next_power(max((group.slots for group in groups if group.tau in little), default=1), 4)
    mid_tick = None if rules.actuation == "deadline" else False
    return [
        replace(
            group,
            length=lengths[group.tau],
            mid_tick=mid_tick,
            slots=slots,
            longest_period=longest,
            general=True,
        )
        if group.tau in little
        else group
        for group in groups
    ]


def batches_of(
    groups: list[Group], num_seeds: int, total_seeds: int, num_robots: int, max_runs: int, snug: bool = False
) -> Iterator[Batch]:
    """Cuts groups into batches of about `max_runs` runs, those that share loop times one after the other.

    Args:
        groups: From `groups_of`.
        num_seeds: S.
        total_seeds: Of the whole study, of which these may be a part; the width of batches hangs on it.
        num_robots: N; a batch holds fewer runs where each has more robots.
        max_runs: Runs of a batch with two robots.
        snug: Whether batches are made as small as their designs allow, at the price of more programs.
    """
    together: dict[tuple[float, int], list[Group]] = {}  # by what says which loop times they share
    for group in groups:
        width = _lanes(group, total_seeds, num_robots, max_runs, snug)
        together.setdefault((group.tau, width), []).append(group)
    for (_, width), own in together.items():
        most = max(1, max_runs * 2 // (max(num_robots, 2) * width))
        for first in range(0, num_seeds, width):
            places = np.arange(first, min(first + width, num_seeds))
            seeds = _filled(places, len(places) if snug else width)
            for group in own:
                yield from _of_group(group, seeds, most, snug)


def _lanes(group: Group, total_seeds: int, num_robots: int, max_runs: int, snug: bool) -> int:
    """Seeds of a batch: more where few designs would leave it small; not where sampling periods share programs."""
    runs = max_runs * 2 // max(num_robots, 2)
    most = min(total_seeds, runs // len(group.designs), _MOST_LOOPS // (group.length * num_robots))
    usual = min(total_seeds, LANES, max_runs)
    return next((lanes for lanes in _WIDE if lanes <= most), usual) if group.alone and not snug else usual


def _of_group(group: Group, seeds: tuple[np.ndarray, int], most: int, snug: bool) -> Iterator[Batch]:
    """The batches of one group on some seeds, of at most that many designs."""
    designs = len(group.designs)
    rows = min(designs, most) if snug else _rows(designs, most, group.general)
    for start in range(0, designs, rows):
        part = group.designs[start : start + rows]
        chosen, real = _filled(part, len(part) if snug else rows)
        yield Batch(group, chosen, seeds[0], real, seeds[1])


def _rows(num_designs: int, most: int, general: bool) -> int:
    """Designs of a batch: parts of equal size where several are needed; fewer are filled up, so that shapes recur.

    Where programs are shared and the work is little, up to a power of four, or to three quarters of a whole batch; else
    by a third at most.
    """
    parts = -(-num_designs // most)
    if parts > 1:
        rows = -(-num_designs // parts)
        return (most * 3 // 4 if 4 * rows <= 3 * most else most) if general and most >= 4 else rows
    power = _next_power(num_designs, 4 if general else 2)
    snug = power * 3 // 4
    return min(most, snug if not general and power >= 4 and num_designs <= snug else power)


def _slots(lag: int) -> int:
    """Capacity of a command buffer for commands that wait up to `lag` sampling periods."""
    least = lag + 2
    return _next_power(least, 2) if least <= _FEW_SLOTS else least


def _next_power(value: int, base: int) -> int:
    """The smallest power of `base` at or above `value`."""
    power = 1
    while power < value:
        power *= base
    return power


def _filled(indices: np.ndarray, length: int) -> tuple[np.ndarray, int]:
    return np.pad(indices, (0, length - len(indices)), mode="edge"), len(indices)
