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
_INSURANCE = ("as it is, deadline x 1.5", "all loop times x 1.5", "all loop times x 1.5, deadline x 1.5")
_POLICIES = {
    "Co-design": "yours lies within: Co-design",
    "MinDelay": "yours is shorter: MinDelay, fresh commands but few of them",
    "MaxRel": "yours is longer: MaxRel, waiting for the last loops",
}


def page(advice: Advice) -> str:
    """The advice as one page for a terminal: the decision first, then what it rests on."""
    lines = [
        *_decision(advice),
        "",
        *_current_lines(advice),
        "",
        "JUDGED ON FRESH SEEDS",
        _table(advice.judged, {"gain": "gain over yours [95 %]"}),
        _tie_line(advice.ties),
        "",
        f"NETWORK  {advice.network.get('name', '')}",
        *_network_lines(advice),
        "",
        "IF THE NETWORK BECOMES WORSE",
        _table(advice.stress, {"change": "change [95 %]"}, beside=True),
        *_cliff(advice),
        "",
        f"MARGIN  With the recommended gains QoC stays within {advice.margin.share:.0%} of its best, and collisions "
        f"within {advice.max_collision_share:.1%} of the runs, for deadlines from {_bound(advice.margin.low)} to "
        f"{_bound(advice.margin.high)} ms",
        *_slack_lines(advice),
        *_sensitivity_lines(advice),
        "",
        scale_text(advice.scale, "of your gains over the deadlines tried, or given", True),
        f"1 would be perfect, {float(qoc(advice.scale.largest, advice.scale)):.3f} is the worst.",
        f"Searched on {advice.seeds['search']} seeds, chosen on {advice.seeds['choice']} others, judged on "
        f"{advice.seeds['fresh']} fresh ones; {advice.simulations} simulations.",
    ]
    return "\n".join(lines)


def _decision(advice: Advice) -> list[str]:
    """What to set, what it costs or gains, what it stands up to, and on what it hangs."""
    best, row = advice.recommended, advice.judged.iloc[-1]
    values = ", ".join(
        f"{name} {float(getattr(best, name)):.3g} {printed_unit(name)}".strip() + ("*" if name in advice.kept else "")
        for name in _GAINS
    )
    collisions = (f"collisions in {row['collision_share']:.1%} [{row['collision_low']:.1%}, "
                  f"{row['collision_high']:.1%}] of the runs, {advice.max_collision_share:.1%} allowed")  # fmt: skip
    own = _ms(advice.current.tau)
    kept = " (kept)" if _ms(best.tau) == own else f", yours {own} ms"
    head = f"deadline {_ms(best.deadline)} ms at tau {_ms(best.tau)} ms{kept}"
    if advice.verdict == "recommended":
        lines = [f"SET THIS: {head}", f"  {values}"]
    else:
        why = "it breaks the limit on" if advice.verdict == "unsafe" else "fresh seeds do not show that it keeps"
        lines = [f"NO RECOMMENDATION: {why} collisions. The closest that was found: {head}", f"  {values}"]
        if row["collision_share"] == 0:
            lines.append(
                "  None of the fresh runs collides, but so small a limit cannot be shown from what was measured."
            )
    if advice.kept:
        lines.append("  * stays as you have it: changing it gains nothing that can be told")
    lines.append(f"  QoC {row['gain']:+.4f} [{row['gain_low']:+.4f}, {row['gain_high']:+.4f}] over yours, "
                 f"{_percent(row['auc'], advice.judged['auc'].iloc[0])} AUC; {collisions}.")  # fmt: skip
    lines += [f"  {line}" for line in (*_robust(advice), *_actuation(advice))]
    if row["gain_low"] <= 0 and advice.acceptable != "no: collisions":
        lines.append("  CAUTION: these seeds do not show that it is better than what you have.")
    if text := bounds_text(advice.at_edge):
        lines.append(f"  {text}")
    return lines


def _percent(value: float, of: float) -> str:
    return f"{value / of - 1.0:+.0%}"


def _robust(advice: Advice) -> list[str]:
    """The worst of the changes, and what standing up to them costs."""
    worst = advice.stress[advice.stress["current_qoc"].notna()].iloc[1:]
    worst = worst.loc[worst["qoc"].idxmin()]
    lines = [f"Worst of the changes below: {worst['what']}, QoC {worst['qoc']:.4f} (yours {worst['current_qoc']:.4f})."]
    if advice.objective == "mean":
        return [*lines, "It was chosen for its mean alone (advise.objective=mean)."]
    other = advice.judged.iloc[-2]
    if abs(other["beyond"]) < 5e-5 and other["deadline"] == advice.judged["deadline"].iloc[-1]:
        return [*lines, "The best by the mean alone is the same."]
    if other["beyond"] <= 0:
        return [*lines, f"The best by the mean alone ({_ms(other['deadline'])} ms) is no better: this costs nothing."]
    return [*lines, f"The best by the mean alone ({_ms(other['deadline'])} ms) would have {other['beyond']:+.4f} "
            f"[{other['beyond_low']:+.4f}, {other['beyond_high']:+.4f}] QoC more: that is what it costs."]  # fmt: skip


def _actuation(advice: Advice) -> list[str]:
    """What changes if commands take effect otherwise."""
    other = advice.actuation
    how = {"arrival": "as they come, as Nav2 does", "deadline": "at their stamp + deadline, by a node that holds them"}
    here, gain = other.here.given, other.gain.given
    return [
        f"It hangs on when commands take effect. Applied {how[other.actuation]}: QoC {here.mean:.4f} [{here.low:.4f}, "
        f"{here.high:.4f}], collisions",
        f"  in {other.collisions.mean:.1%} [{other.collisions.low:.1%}, {other.collisions.high:.1%}]; the best "
        f"deadline would then be {_ms(other.best_deadline)} ms ({gain.mean:+.4f} [{gain.low:+.4f}, {gain.high:+.4f}]).",
    ]


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
    margin, now, rest = advice.current_margin, advice.judged.iloc[0], advice.judged.iloc[1]
    close = (
        f"{now['collision_share']:.1%} [{now['collision_low']:.1%}, {now['collision_high']:.1%}] of its runs collide"
    )
    answers = {
        "yes": f"YES: {close}, and QoC is within {margin.share:.0%} of its best.",
        "no: collisions": f"NO: {close}, {advice.max_collision_share:.1%} are allowed.",
        "no: QoC": f"NO: with your gains QoC is within {margin.share:.0%} of its best, and collisions in the limit, "
                   f"from {_bound(margin.low)} to {_bound(margin.high)} ms.",
        "not shown": f"NOT SHOWN: {close}; the upper end breaks {advice.max_collision_share:.1%}.",
    }  # fmt: skip
    return [
        f"IS {_ms(now['deadline'])} ms ACCEPTABLE? {answers[advice.acceptable]}",
        f"  {_POLICIES[advice.policy]}. {_ms(rest['deadline'])} ms would change QoC by {rest['gain']:+.4f} "
        f"[{rest['gain_low']:+.4f}, {rest['gain_high']:+.4f}].",
    ]


def _slack_lines(advice: Advice) -> list[str]:
    if advice.slack is None:
        return []
    slack = advice.slack
    return [
        f"  Were delay constant and losses independent, QoC would stay above {slack.target:.4f} "
        f"({slack.target / advice.judged['qoc'].iloc[-1]:.0%} of the recommended) up to a delay of "
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
        least = GROWTHS[0] if growth.low is None else growth.low
        lines = [f"  All loop times may grow by more than a factor of {GROWTHS[-1]:g} (surely {least:.3g}) before QoC "
                 f"falls by {share:.0%}."]  # fmt: skip
    else:
        low, high = (GROWTHS[0] if end is None else end for end in (growth.low, growth.high))
        most = "or more" if growth.high_at_edge else ""
        lines = [
            f"  With this deadline all loop times may grow by {growth.value - 1:.0%} "
            f"[{low - 1:.0%}, {f'{high - 1:.0%} {most}'.strip()}] before QoC falls by {share:.0%}."
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


def _table(rows: pd.DataFrame, difference: dict[str, str], beside: bool = False) -> str:
    name, title = next(iter(difference.items()))
    columns = {
        "": rows["what"],
        "deadline (ms)": rows["deadline"].map(_ms),
        "AUC (s)": rows["auc"].map("{:.3g}".format),
        "QoC [with J_med's error]": [
            f"{row.qoc:.4f} [{row.qoc_whole_low:.4f}, {row.qoc_whole_high:.4f}]" for row in rows.itertuples()
        ],
        title: [
            f"{row[name]:+.4f} [{row[f'{name}_low']:+.4f}, {row[f'{name}_high']:+.4f}]" if k else ""
            for k, (_, row) in enumerate(rows.iterrows())
        ],
        "loops": rows["completed_share"].map("{:.1%}".format),
        "collisions [95 %]": [
            f"{row.collision_share:.1%} [{row.collision_low:.1%}, {row.collision_high:.1%}]"
            for row in rows.itertuples()
        ],
        "closest (m)": rows["min_distance"].map("{:.2f}".format),
    }
    if beside:
        columns["QoC of yours"] = ["" if np.isnan(each) else f"{each:.4f}" for each in rows["current_qoc"]]
    else:
        columns["there after (s)"] = [_arrival(row) for row in rows.to_dict("records")]
    return "\n".join("  " + line for line in pd.DataFrame(columns).to_string(index=False).splitlines())


def _arrival(row: dict) -> str:
    """Mean time until all robots are there; of how many runs, where not of all."""
    if not row["arrived_share"] > 0:
        return "never"
    text = f"{row['arrival_time']:.1f}"
    return text if row["arrived_share"] == 1 else f"{text} ({row['arrived_share']:.0%} of runs)"


def _ms(seconds: object) -> str:
    return f"{1e3 * float(np.asarray(seconds)):.4g}"


def _bound(bound: Bound, scale: float = 1e3) -> str:
    """A bound with its interval; what was looked at may end before it."""
    numbers = ["none" if v is None else f"{scale * v:.3g}" for v in (bound.value, bound.low, bound.high)]
    if bound.value is None:
        return "none that was looked at,"
    if bound.at_edge:
        return f"{numbers[0]} (where the search ends)"
    ends = [f"{text} or beyond" if end else text
            for text, end in zip(numbers[1:], (bound.low_at_edge, bound.high_at_edge), strict=True)]  # fmt: skip
    return f"{numbers[0]} [{ends[0]}, {ends[1]}]"
