"""Commands of a recorded run: how regularly they came, and how long a robot ran on an old one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qocjax.recorded.findings import Findings
from qocjax.recorded.series import Cleaning, Series

__all__ = ["CommandReport", "gaps", "report_commands"]


@dataclass(frozen=True)
class CommandReport:
    """One robot's commands; times in s."""

    count: int
    period: float  # usual interval between two, the median
    period_low: float  # 5 and 95 % of the intervals that are no gaps
    period_high: float
    gaps: int  # intervals much longer than that
    longest_gap: float
    hold_time: float  # that commands stayed in force beyond the usual interval, in gaps
    hold_share: float  # of the time between the first command and the last
    driving_hold_time: float  # the part of it in which the command in force was not to stand still
    v_max: float  # largest |nu|, m/s, without outliers
    omega_max: float  # largest |omega|, rad/s, without outliers
    effort: float  # ∫ nu² + omega² dt, without outliers
    outliers: int


def gaps(time: np.ndarray, cleaning: Cleaning) -> tuple[float, np.ndarray]:
    """The usual interval of a series (s), and which of its intervals are gaps."""
    every = np.diff(time)
    usual = float(np.median(every)) if every.size else float("nan")
    return usual, every > max(cleaning.gap * usual, cleaning.least_gap)


def report_commands(series: Series, where: str, cleaning: Cleaning, findings: Findings) -> CommandReport | None:
    """What the commands of a topic were like; None for fewer than two.

    A hold is counted as the robot sees it: a command stays in force until the next is recorded.
    """
    time = np.sort(series.record)
    nu, omega = series.values[np.argsort(series.record, kind="stable"), :2].T
    outlier = (np.abs(nu) > cleaning.max_speed) | (np.abs(omega) > cleaning.max_turn_rate)
    findings.count(where, "outlier_commands", int(outlier.sum()))
    if outlier.any():
        text = f"{where}: commands of up to {np.abs(nu).max():.4g} m/s and {np.abs(omega).max():.4g} rad/s"
        findings.note(text)
    if time.size < 2:
        findings.note(f"{where}: has {time.size} commands, too few to say anything of them")
        return None
    usual, wide = gaps(time, cleaning)
    findings.count(where, "gaps", int(wide.sum()))
    every, beyond = np.diff(time), np.where(wide, np.diff(time) - usual, 0.0)
    moving = (nu[:-1] != 0.0) | (omega[:-1] != 0.0)
    kept = ~outlier
    spread = np.percentile(every[~wide], (5, 95))
    effort = np.where(kept, nu**2 + omega**2, 0.0)[:-1] @ every
    return CommandReport(
        count=time.size, period=usual, period_low=float(spread[0]), period_high=float(spread[1]),
        gaps=int(wide.sum()), longest_gap=float(every.max()),
        hold_time=float(beyond.sum()), hold_share=float(beyond.sum() / max(np.ptp(time), 1e-12)),
        driving_hold_time=float(beyond[moving].sum()),
        v_max=float(np.abs(nu[kept]).max(initial=0.0)), omega_max=float(np.abs(omega[kept]).max(initial=0.0)),
        effort=float(effort), outliers=int(outlier.sum()),
    )  # fmt: skip
