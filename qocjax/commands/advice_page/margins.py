"""What the page says of margins: of the deadline, of growing delay, of delay and reliability apart, of parameters."""

from __future__ import annotations

import numpy as np

from qocjax.advice.advice import Advice
from qocjax.advice.stress import GROWTHS
from qocjax.commands.advice_page.words import bound_text, ms, safety_of, unless_alone

__all__ = ["cliff_lines", "margin_lines", "sensitivity_lines", "slack_lines"]

_INSURANCE = ("as it is, deadline x 1.5", "all loop times x 1.5", "all loop times x 1.5, deadline x 1.5")
_LITTLE = 0.05  # of QoC; what is lost beyond it is a cliff


def margin_lines(advice: Advice) -> list[str]:
    """Between which deadlines the target is kept with the recommended gains."""
    margin, target = advice.margin, advice.target
    if not margin.reached:
        return [f"MARGIN  None: with the recommended gains there is no deadline at which {target.text}; the best is "
                f"{margin.best_text}."]  # fmt: skip
    limit = f"{advice.max_collision_share:.1%}"
    safe = {
        "alone": "",
        "kept": f", and collisions keep {limit} by the upper end of their interval,",
        "not shown": f", and collisions are not shown to break {limit},",
        "broken": ", but collisions break their limit,",
    }[safety_of(advice, margin)]
    return [
        f"MARGIN  With the recommended gains {target.text}{safe}",
        f"  for deadlines from {bound_text(margin.low)} to {bound_text(margin.high)} ms.",
    ]


def slack_lines(advice: Advice) -> list[str]:
    """How far delay or reliability may go, each by itself."""
    slack = advice.slack
    if slack is None:
        return []
    alone = "  Were delay constant and losses independent, "
    safe = unless_alone(advice, ", and collisions keep their limit")
    if not slack.reached:
        return [f"{alone}it would at no delay and F of the plane be so that {slack.target.text}{safe}."]
    text = slack.target.text if slack.target.absolute else f"QoC is above {slack.level:.4f}"
    longest, least = f"at F = {slack.reliability:.3g}", f"at a delay of {ms(slack.delay)} ms"
    return [
        f"{alone}it would be so that {text}{safe},",
        ("  at no delay that was looked at" if slack.largest_delay.value is None else
         f"  up to a delay of {bound_text(slack.largest_delay)} ms") + f" {longest}, and "
        + ("at no F that was looked at" if slack.smallest_reliability.value is None else
           f"down to F = {bound_text(slack.smallest_reliability, 1.0)}") + f" {least}.",
    ]  # fmt: skip


def sensitivity_lines(advice: Advice) -> list[str]:
    """Which parameters matter, nearby and over all bounds."""
    near = ", ".join(f"{row.parameter} {row.elasticity:+.2f} %" for row in advice.elasticities.itertuples())
    lines = [f"  1 % more of a parameter changes QoC by: {near}"]
    if advice.sobol is not None:
        ranked = advice.sobol.sort_values("total", ascending=False)
        far = ", ".join(f"{row.parameter} {max(row.total, 0.0):.0%}" for row in ranked.itertuples())
        lines.append(f"  Over all bounds QoC varies because of (total Sobol indices): {far}")
    return lines


def cliff_lines(advice: Advice) -> list[str]:
    """How much the delay may grow, a warning where that is little, and what a longer deadline would cost and save."""
    stress, change = advice.stress.set_index("what"), advice.stress.set_index("what")["change"]
    now, kept, longer = (float(change[what]) for what in _INSURANCE)
    before, after = float(stress["qoc"].iloc[0]), float(stress["qoc"][_INSURANCE[1]])
    lines = [_growth(advice)]
    if -kept > _LITTLE * before:
        left = float(stress["completed_share"][_INSURANCE[1]])
        lines.append(
            f"  BEWARE OF THE CLIFF: should delay grow by half, {left:.1%} of the loops complete, and QoC falls from "
            f"{before:.3f} to {after:.3f}."
        )
    if longer - kept > _LITTLE * before:
        at = ms(1.5 * float(np.asarray(advice.recommended.deadline)))
        lines.append(f"  A deadline of {at} ms costs {max(0.0, -now):.4f} QoC now and saves {longer - kept:.4f} then.")
    return lines


def _growth(advice: Advice) -> str:
    """By how much all loop times may grow."""
    growth, lost = advice.growth, advice.target.lost
    if growth.value is None:
        return f"  With this deadline the target is missed already: {lost}."
    if growth.at_edge:
        least = GROWTHS[0] if growth.low is None else growth.low
        return (f"  All loop times may grow by more than a factor of {GROWTHS[-1]:g} (surely {least:.3g}) before "
                f"{lost}.")  # fmt: skip
    low, high = (GROWTHS[0] if end is None else end for end in (growth.low, growth.high))
    most = f"{high - 1:.0%}{' or more' if growth.high_at_edge else ''}"
    return (f"  With this deadline all loop times may grow by {growth.value - 1:.0%} [{low - 1:.0%}, {most}] before "
            f"{lost}.")  # fmt: skip
