"""The page of an advice: what a terminal shows."""

from __future__ import annotations

import numpy as np
import pandas as pd

from qocjax._command import printed_unit
from qocjax.quality import qoc
from qocjax.study.advice import Advice, plain
from qocjax.study.edges import bounds_text
from qocjax.study.margins import Bound
from qocjax.study.reliability import share_text
from qocjax.study.scales import scale_text
from qocjax.study.stress import GROWTHS

__all__ = ["page"]

_GAINS = ("kappa", "gamma", "eta", "c_miss", "v_max", "omega_max", "d_safe")
_INSURANCE = ("as it is, deadline x 1.5", "delay x 1.5, deadline kept", "delay x 1.5, deadline x 1.5")
_POLICIES = {
    "Co-design": "yours lies within: Co-design",
    "MinDelay": "yours is shorter: MinDelay, fresh commands but few of them",
    "MaxRel": "yours is longer: MaxRel, waiting for the last loops",
}


def page(advice: Advice) -> str:
    """The advice as one page for a terminal."""
    best, ties = advice.recommended, advice.ties
    values = ", ".join(f"{name} {float(getattr(best, name)):.3g} {printed_unit(name)}".strip() for name in _GAINS)
    lines = [
        f"NETWORK  {advice.network.get('name', '')}",
        *_network_lines(advice),
        "",
        f"RECOMMENDED  deadline {_ms(best.deadline)} ms at tau {_ms(best.tau)} ms (kept){_safer(advice)}",
        f"  {values}",
        _table(advice.judged, {"gain": "gain over current [95 %]"}),
        *_current_lines(advice),
        _tie_line(ties),
        *([f"  {text}"] if (text := bounds_text(advice.at_edge)) else []),
        *_doubts(advice),
        "",
        f"MARGIN  QoC stays within {advice.margin.share:.0%} of its best for deadlines from "
        f"{_bound(advice.margin.low)} to {_bound(advice.margin.high)} ms",
        *_slack_lines(advice),
        *_sensitivity_lines(advice),
        "",
        "IF THE NETWORK BECOMES WORSE",
        _table(advice.stress, {"change": "change [95 %]"}),
        *_cliff(advice),
        "",
        scale_text(advice.scale, "of your gains over the deadlines tried, or given", True),
        f"1 would be perfect, {float(qoc(advice.scale.largest, advice.scale)):.3f} is the worst.",
        f"Chosen on {advice.seeds['search']} seeds, judged on {advice.seeds['fresh']} fresh ones; "
        f"{advice.simulations} simulations.",
    ]  # fmt: skip
    return "\n".join(lines)


def _network_lines(advice: Advice) -> list[str]:
    loop = advice.character
    percent = ", ".join(
        f"{name} {'none' if d is None else f'{d:.4g}'}" for name, d in plain(loop["percentiles_ms"]).items()
    )
    f_current = share_text(*advice.judged[["reliability", "reliability_se"]].iloc[0])
    f_best = share_text(loop["reliability"], loop["reliability_se"])
    run, alone = loop["mean_miss_run"], loop["independent_miss_run"]
    bursts = "no loop is missed" if run is None else (
        f"misses come {run:.2g} in a row on average ({alone:.2g} if independent), "
        f"99 % of these runs within {loop['p99_miss_run']}"
    )  # fmt: skip
    hangs = loop["delay_correlation"]
    return [
        f"  loop times that arrive (ms): {percent}; never: {loop['lost_share']:.2%} (lost, or dropped at a busy edge)",
        f"  F({_ms(advice.recommended.deadline)} ms) = {f_best}, "
        f"F({_ms(advice.current.deadline)} ms) = {f_current}; rank correlation of successive delays: "
        + ("not defined" if hangs is None else f"{hangs:.2f}"),
        f"  at {_ms(advice.recommended.deadline)} ms {bursts}",
        f"  {advice.capacity}",
        *([f"  NOTE: {advice.trace}"] if advice.trace else []),
    ]


def _current_lines(advice: Advice) -> list[str]:
    """Whether the present deadline is acceptable, with the present gains."""
    margin, now = advice.current_margin, advice.judged.iloc[0]
    rest = advice.judged.iloc[1]
    return [
        f"  IS {_ms(now['deadline'])} ms ACCEPTABLE? With your gains QoC stays within {margin.share:.0%} of its best "
        f"from {_bound(margin.low)} to {_bound(margin.high)} ms;",
        f"  {_POLICIES[advice.policy]}. {_ms(rest['deadline'])} ms would change QoC by {rest['gain']:+.4f} "
        f"[{rest['gain_low']:+.4f}, {rest['gain_high']:+.4f}].",
    ]  # fmt: skip


def _slack_lines(advice: Advice) -> list[str]:
    if advice.slack is None:
        return []
    slack = advice.slack
    return [
        f"  Were delay constant and losses independent, QoC would stay above {slack.target:.4f} up to a delay of "
        f"{_bound(slack.largest_delay)} ms at F = {slack.reliability:.3g},",
        f"  and down to F = {_bound(slack.smallest_reliability, 1.0)} at a delay of {_ms(slack.delay)} ms.",
    ]


def _sensitivity_lines(advice: Advice) -> list[str]:
    near = ", ".join(f"{row.parameter} {row.elasticity:+.2f} %" for row in advice.elasticities.itertuples())
    lines = [f"  1 % more of a parameter changes QoC by: {near}"]
    if advice.sobol is not None:
        ranked = advice.sobol.sort_values("total", ascending=False)
        far = ", ".join(f"{row.parameter} {max(row.total, 0.0):.0%}" for row in ranked.itertuples())
        lines.append(f"  Over all bounds QoC varies because of (total Sobol indices): {far}")
    return lines


def _doubts(advice: Advice) -> list[str]:
    """Where the fresh seeds do not bear out what the design was chosen for."""
    then, lines = advice.judged.iloc[-1], []
    if then["collision_share"] > advice.max_collision_share:
        lines.append(
            f"  CAUTION: on fresh seeds {then['collision_share']:.1%} of its runs collide, more than the "
            f"{advice.max_collision_share:.1%} allowed; it kept the limit on the seeds of the search."
        )
    if then["gain_low"] <= 0:
        lines.append("  CAUTION: these seeds do not show that it is better than what you have.")
    return lines


def _safer(advice: Advice) -> str:
    """A hint at the longer deadline, where it costs little now and saves much should the delay grow."""
    now, kept, longer = _changes(advice)
    enough = advice.margin.share * float(advice.stress["qoc"].iloc[0])
    if -now > 0.2 * enough or longer - kept < enough:
        return ""
    return f"; {_ms(1.5 * float(np.asarray(advice.recommended.deadline)))} ms is nearly as good and safer, see below"


def _changes(advice: Advice) -> list[float]:
    """Of QoC: with half more deadline, with half more delay, and with both."""
    change = advice.stress.set_index("what")["change"]
    return [float(change[what]) for what in _INSURANCE]


def _cliff(advice: Advice) -> list[str]:
    """How much the delay may grow, a warning where that is little, and what a longer deadline would cost and save."""
    stress = advice.stress.set_index("what")
    now, kept, longer = _changes(advice)
    before, after = float(stress["qoc"].iloc[0]), float(stress["qoc"][_INSURANCE[1]])
    growth, share = advice.growth, advice.margin.share
    if growth.value is None or growth.at_edge:
        lines = [f"  All loop times may grow by more than a factor of {GROWTHS[-1]:g} before QoC falls by {share:.0%}."]
    else:
        low, high = (GROWTHS[0] if end is None else end for end in (growth.low, growth.high))
        lines = [
            f"  With this deadline all loop times may grow by {growth.value - 1:.0%} "
            f"[{low - 1:.0%}, {high - 1:.0%}] before QoC falls by {share:.0%}."
        ]
    at = _ms(1.5 * float(np.asarray(advice.recommended.deadline)))
    if -kept > share * before:
        left = float(stress["completed_share"][_INSURANCE[1]])
        lines.append(
            f"  BEWARE OF THE CLIFF: should delay grow by half, {left:.1%} of the loops complete, and QoC falls from "
            f"{before:.3f} to {after:.3f}."
        )
    if longer - kept > share * before:
        lines.append(f"  A deadline of {at} ms costs {max(0.0, -now):.4f} QoC now and saves {longer - kept:.4f} then.")
    return lines


def _tie_line(ties: pd.DataFrame) -> str:
    if len(ties) < 2:
        return "  No other finalist ties with it."
    spans = [f"{name} {ties[name].min():.3g} to {ties[name].max():.3g}" for name in _GAINS if np.ptp(ties[name]) > 0]
    spans.append(f"deadline {_ms(ties['deadline'].min())} to {_ms(ties['deadline'].max())} ms")
    return f"  {len(ties) - 1} other finalist{'s' if len(ties) > 2 else ''} cannot be told from it: " + ", ".join(spans)


def _table(rows: pd.DataFrame, difference: dict[str, str]) -> str:
    name, title = next(iter(difference.items()))
    shown = pd.DataFrame(
        {
            "": rows["what"],
            "deadline (ms)": rows["deadline"].map(_ms),
            "QoC [with J_med's error]": [
                f"{row.qoc:.4f} [{row.qoc_whole_low:.4f}, {row.qoc_whole_high:.4f}]" for row in rows.itertuples()
            ],
            title: [
                f"{row[name]:+.4f} [{row[f'{name}_low']:+.4f}, {row[f'{name}_high']:+.4f}]" if k else ""
                for k, (_, row) in enumerate(rows.iterrows())
            ],
            "loops completed": rows["completed_share"].map("{:.1%}".format),
            "collisions [95 %]": [
                f"{row.collision_share:.1%} [{row.collision_low:.1%}, {row.collision_high:.1%}]"
                for row in rows.itertuples()
            ],
        }
    )  # fmt: skip
    return "\n".join("  " + line for line in shown.to_string(index=False).splitlines())


def _ms(seconds: object) -> str:
    return f"{1e3 * float(np.asarray(seconds)):.4g}"


def _bound(bound: Bound, scale: float = 1e3) -> str:
    """A bound with its interval; what was looked at may end before it."""
    numbers = ["none" if v is None else f"{scale * v:.3g}" for v in (bound.value, bound.low, bound.high)]
    if bound.value is None:
        return "none that was looked at,"
    return f"{numbers[0]} (where the search ends)" if bound.at_edge else f"{numbers[0]} [{numbers[1]}, {numbers[2]}]"
