"""N robots on the air of one cell in plain Python: slot after slot hands out its bits (section 13 of the model).

Slow and independent on purpose: it keeps a queue for each direction, and knows nothing of cumulated bits.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import count
from typing import Any

import numpy as np
from slow_edge import edge, rotating, whole

LEAST = 1e-6  # bits; less than this is rounding


def slots(direction: str, pattern: str, bits: Any) -> Any:
    """(number, bits) of the slots of one direction; `bits` is a number, or [slots] from slot 0 on."""
    for n in count() if np.ndim(bits) == 0 else range(len(bits)):
        if pattern[n % len(pattern)] == direction:
            yield n, float(bits if np.ndim(bits) == 0 else bits[n])


def air(ready: np.ndarray, bits: np.ndarray, carriers: Any, length: float) -> np.ndarray:
    """When each message leaves the air: [P, N] in s, from when it is ready (s, inf for none) and its bits."""
    # Whole picoseconds, so that messages of one instant are told by their order alone, and a slot takes what is
    # ready when it begins.
    instant = {k: whole(ready[k]) for k in np.ndindex(ready.shape) if ready[k] < math.inf}
    queue = deque(sorted(instant, key=lambda k: (instant[k], rotating(*k, ready.shape[1]))))
    left = np.array(bits, float)
    leaves = np.full(ready.shape, math.inf)
    for n, room in carriers:
        while queue and room > LEAST and instant[queue[0]] <= n * whole(length):
            message = queue[0]
            carried = min(room, left[message])
            room, left[message] = room - carried, left[message] - carried
            if left[message] <= LEAST:
                leaves[queue.popleft()] = (n + 1) * length
        if not queue:
            return leaves
    raise ValueError(f"slot_bits: the slots given end before {len(queue)} messages are through")


def cell_loop(
    compute: Any, tau: float, *, slot: float, pattern: str, slot_bits: tuple[Any, Any], bits: tuple[Any, Any],
    transmissions: tuple[Any, Any] = (1, 1), lost: tuple[Any, Any] = (False, False), harq_rtt: float = 7.5e-3,
    access: Any = 0.0, stagger: bool = False, core: float = 0.0, workers: int = 1, per_robot: bool = True,
    discipline: str = "unlimited", deadline: float | None = None, exact: bool = True,
) -> np.ndarray:  # fmt: skip
    """Loop times of robots that share a cell and an edge.

    Pairs are (uplink, downlink). `compute` is [P, N] in s; `slot` the length of a slot in s; `pattern` of letters D, U
    and S; `slot_bits` what a slot of the direction carries, a number or an array over all slots from 0 on. By message,
    [P, N] or a number: `bits`, the `transmissions` that take place (at least 1), and whether it is `lost` after them.
    `harq_rtt`, `access` and `core` are in s; the core of the downlink comes after the air. The rest is as in
    `edge_loop`, `exact` too: the air is exact in any case.

    Returns:
        T_net [P, N] in s from the sampling instant, inf where lost, dropped or given up.

    Raises:
        ValueError: for a pattern or slots that carry nothing in one direction, or an array of slots that is too short.
    """
    if not {"U", "D"} <= set(pattern):
        raise ValueError(f"pattern: got {pattern!r}, expected slots of both directions")
    if min(np.max(b) for b in slot_bits) <= LEAST:
        raise ValueError(f"slot_bits: got {slot_bits}, expected more than 0 in both directions")
    shape = num_ticks, num_robots = np.shape(compute)
    tick = np.arange(num_ticks)[:, None] * np.full((1, num_robots), tau)

    def cross(which: int, ready: np.ndarray) -> np.ndarray:
        sent = np.broadcast_to(transmissions[which], shape)
        load = np.broadcast_to(bits[which], shape) * sent
        leaves = air(ready, load, slots("UD"[which], pattern, slot_bits[which]), slot)
        return np.where(np.broadcast_to(lost[which], shape), math.inf, leaves + (sent - 1) * harq_rtt + core)

    offset = np.arange(num_robots) * tau / num_robots if stagger else np.zeros(num_robots)
    uplink = cross(0, tick + offset[None, :] + access) - tick
    options = {"workers": workers, "per_robot": per_robot, "discipline": discipline, "deadline": deadline}
    return cross(1, tick + edge(uplink, compute, tau, **options, exact=exact).end) - tick
