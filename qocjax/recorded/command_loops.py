"""Loop times out of stamped commands, where their stamps are proven to be those of the states that they answer."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.loops import COLUMNS, LoopTrace
from qocjax.recorded.series import Series

__all__ = ["command_loops"]

_PROOF = 0.5  # share of the commands' stamps that must be those of a pose
_CHANCE = 0.2  # share that would be by chance, from where on it proves nothing

Array = NDArray[np.float64]


def command_loops(
    robot: str, commands: Series, states: list[Series], where: str, on_robot_clock: bool, findings: Findings, begin: int
) -> LoopTrace | None:
    """The loops that stamped commands tell of: each bears the stamp of the state that it answers (paper, D_cfg).

    Nav2 and most other publishers stamp a command with the time at which they publish it. Then record time less stamp
    is the transport of the command and no loop; the proof of the other case is that commands bear stamps of poses.
    The delay is record time less stamp, both on the robot's clock; a stamp of a pose that no command bears is a lost
    loop.

    Args:
        robot: Its name.
        commands: Its commands.
        states: Its poses, of every topic that has some.
        where: Topic of the commands, for findings.
        on_robot_clock: Whether what recorded the commands ran on the clock of their stamps.
        findings: Takes counts and remarks.
        begin: Record time that counts as 0 (ns).

    Returns:
        The trace; None where the stamps tell no loop time, which a remark says.
    """
    has = np.isfinite(commands.stamp)
    delay, stamp = (commands.record - commands.stamp)[has], np.round(commands.stamp[has], 7)
    if not has.any():
        return None
    if not on_robot_clock or not 0.0 <= np.median(delay) <= max(np.ptp(commands.record), 1.0):
        findings.count(where, "clock_unknown")
        findings.note(f"{where}: stamps are of another clock than the record times; no loop times")
        return None
    known = np.unique(np.round(np.concatenate([s.stamp[np.isfinite(s.stamp)] for s in states] or [np.empty(0)]), 7))
    tick = _tick(np.concatenate([stamp, known, commands.record]))
    if not _proven(np.unique(stamp), known, float(np.median(delay)), tick, where, findings):
        return None
    findings.count(where, "negative_loop_time", int((delay < 0.0).sum()))
    best = pd.Series(delay[delay >= 0.0]).groupby(stamp[delay >= 0.0]).min()
    known = known[(known >= best.index.min()) & (known <= best.index.max())]
    best = best.reindex(np.union1d(known, best.index), fill_value=np.inf)
    source = best.index.to_numpy()
    table = pd.DataFrame({
        "sequence": np.arange(len(best)), "session": "", "number": np.arange(len(best)),
        "source_stamp": source - source[0], "uplink": np.nan, "compute": np.nan, "downlink": np.nan,
        "loop_time": best.to_numpy(), "lost": np.isinf(best.to_numpy()),
    })  # fmt: skip
    empty = pd.DataFrame({"source_stamp": [], "uplink": [], "downlink": []}, dtype=float)
    return LoopTrace(robot, table[COLUMNS], 1e-9 * begin + source[0], None, (), empty)


def _proven(stamp: Array, known: Array, delay: float, tick: float, where: str, findings: Findings) -> bool:
    """Whether the commands' stamps are those of poses, and not because a simulated clock has few of them."""
    share = float(np.isin(stamp, known).mean())
    span = float(np.ptp(known)) if known.size else 0.0
    chance = (known.size - 1) * tick / span if span > 0.0 else 0.0
    advice = (
        "as where commands are stamped when they are published (Nav2, teleop, twist_mux). Copy the stamp of the pose "
        "that a command answers into its header, or take the delay between commands and motion"
    )
    if share <= _PROOF:
        findings.note(f"{where}: {share:.0%} of the stamps are those of poses, so they tell no loop time, {advice}")
        return False
    if chance > _CHANCE and delay <= tick:
        findings.note(
            f"{where}: times go in steps of {1e3 * tick:.4g} ms, as of a simulated clock, and commands are recorded "
            f"within one, so it cannot be known whether their stamps are those of poses; no loop times, {advice}"
        )
        return False
    if share < 1.0:
        findings.note(f"{where}: {share:.0%} of the stamps are those of poses that were recorded")
    return True


def _tick(stamp: Array) -> float:
    """The step that all times go in (s)."""
    every = np.diff(np.unique(np.round(1e7 * stamp).astype(np.int64)))
    return 1e-7 * float(np.gcd.reduce(every)) if every.size else 0.0
