"""The decision: what to set, what it gains, what it stands up to, on what it was judged and on what it hangs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from qocjax.advice.advice import Advice
from qocjax.commands.advice_page.tables import arrival_text
from qocjax.commands.advice_page.words import (
    GAINS,
    bound_text,
    collisions_text,
    ms,
    percent,
    safety_of,
    with_collisions,
    with_ends,
)
from qocjax.commands.assumed import Given
from qocjax.statistics.collisions import ALONE, is_alone
from qocjax.study.edges import bounds_text
from qocjax.units import printed_unit

__all__ = ["decision_lines", "present_lines"]

_POLICIES = {
    "Co-design": "It lies within the margin: Co-design",
    "MinDelay": "It is shorter: MinDelay, fresh commands but few of them",
    "MaxRel": "It is longer: MaxRel, waiting for the last loops",
}
_LAWS = {"Apf": "the surrogate law", "Cbf": "the barrier", "NavigationStack": "the navigation stack"}
_OUTAGES = "OUTAGES    Without multicast (5G) Cyclone DDS may come back 30 s late, or not at all: docs/middleware.md."


def decision_lines(advice: Advice, given: Given) -> list[str]:
    """What to set, and all that one has to know to do so."""
    lines = [*_hardly(advice), *_head(advice)]
    if advice.kept:
        stays = "you have it" if given.gains else "it is by default"
        lines.append(f"  * stays as {stays}: changing it gains nothing that can be told")
    said = (_gain(advice, given), _stands(advice, given), [_cost(advice)], _judged_on(advice), _assumptions(advice))
    lines += [f"  {line}" for part in said for line in part]
    if advice.judged["gain_low"].iloc[-1] <= 0 and advice.acceptable != "no: collisions":
        lines.append(f"  CAUTION: these seeds do not show that it is better than {given.own}.")
    lines.append(f"  {_OUTAGES}")
    if text := bounds_text(advice.at_edge):
        lines.append(f"  {text}")
    return lines


def _hardly(advice: Advice) -> list[str]:
    """That the delay hardly matters, where present and recommended deadline differ by what is little; or nothing."""
    little, margin, pair = advice.target.little, advice.current_margin, advice.judged.iloc[:2].to_dict("records")
    if little is None or not advice.acceptable.startswith("yes") or not margin.holds(float(pair[1]["deadline"])):
        return []
    now, then = pair
    apart = little.further(abs(now["auc"] - then["auc"]))
    return [
        f"THE DELAY HARDLY MATTERS HERE, for deadlines from {bound_text(margin.low)} to {bound_text(margin.high)} ms.",
        f"  At {ms(now['deadline'])} and {ms(then['deadline'])} ms, with the same gains, AUC is {now['auc']:.3g} and "
        f"{then['auc']:.3g} s, and all robots are there after {arrival_text(now)} and {arrival_text(then)} s.",
        f"  They are {apart:.2g} m further off their way (root mean square); up to {little.distance:.3g} m, a radius, "
        "are taken for little.",
        f"  QoC is relative to J_med, here {advice.scale.median:.2g} s, and makes much of it.",
        "",
    ]


def _head(advice: Advice) -> list[str]:
    best, own = advice.recommended, ms(advice.current.tau)
    names, numbers = [*(name for name in GAINS if name not in advice.unread), *best.others], best.values()
    values = ", ".join(
        f"{name.removeprefix('controller.')} {float(numbers[name]):.3g} {printed_unit(name)}".strip()
        + ("*" if name in advice.kept else "")
        for name in names
    )
    kept = " (kept)" if ms(best.tau) == own else f" instead of {own} ms"
    head = f"deadline {ms(best.deadline)} ms at tau {ms(best.tau)} ms{kept}"
    if advice.verdict == "recommended":
        return [f"SET THIS: {head}", f"  {values}"]
    why = "it breaks the limit on" if advice.verdict == "unsafe" else "fresh seeds do not show that it keeps"
    lines = [f"NO RECOMMENDATION: {why} collisions. The closest that was found: {head}", f"  {values}"]
    if advice.judged["collision_share"].iloc[-1] == 0:
        lines.append("  None of the fresh runs collides, but so small a limit cannot be shown from what was measured.")
    return lines


def _gain(advice: Advice, given: Given) -> list[str]:
    """What it gains, and whether it is safe; where no design reaches the target, that."""
    now, row = advice.judged.iloc[0], advice.judged.iloc[-1]
    lines = [
        f"It gains   QoC {with_ends(row, 'gain', '+.4f')} over {given.own}, {row['qoc']:.4f} after {now['qoc']:.4f}; "
        f"AUC {with_ends(row, 'auc', '.3g')} s, {percent(row['auc'], now['auc'])}.",
        f"Safety     {_safety(row, advice.max_collision_share)}.",
    ]
    here, own = advice.margin, advice.current_margin
    if advice.target.absolute and not (here.reached or own.reached):
        lines.append(f"TARGET     CANNOT BE REACHED: {advice.target.text}. The best is {here.best_text}; with "
                     f"{given.own}, {own.best_text}.")  # fmt: skip
    return lines


def _safety(row: Mapping[str, Any], limit: float) -> str:
    """Collisions of a design, and how close robots come."""
    if is_alone(row["collision_high"]):
        return f"{ALONE[0].upper()}{ALONE[1:]}; walls of a map do not count"
    return (f"Collisions in {collisions_text(row)} of the runs, {limit:.1%} allowed; never closer than "
            f"{row['min_distance']:.2f} m")  # fmt: skip


def _stands(advice: Advice, given: Given) -> list[str]:
    """Which of the changes it stands up to: the target and the limit on collisions are kept; and the worst of them."""
    rows = advice.stress[advice.stress["current_qoc"].notna()].iloc[1:]
    lines = []
    for answer, begin in (("yes", "Stands up  to"), ("not shown", "Not shown  for"), ("no", "NOT        to")):
        found = rows[rows["stands"] == answer].to_dict("records")
        texts = [row["what"] + ("" if answer == "yes" else f" (QoC {row['qoc']:.4f}"
                 f"{with_collisions(row, 'collisions')})") for row in found]  # fmt: skip
        lines += [f"{begin} {'; '.join(texts)}."] if texts else []
    worst = rows.loc[rows["qoc"].idxmin()]
    return [*lines, f"Worst      {worst['what']}: QoC {with_ends(worst, 'qoc', '.4f')}, {given.own} "
            f"{worst['current_qoc']:.4f} there."]  # fmt: skip


def _cost(advice: Advice) -> str:
    """What standing up to changes costs."""
    if advice.objective == "mean":
        return "It costs   It was chosen for its mean alone (advise.objective=mean)."
    other = advice.judged.iloc[-2]
    if abs(other["beyond"]) < 5e-5 and other["deadline"] == advice.judged["deadline"].iloc[-1]:
        return "It costs   Nothing: the best by the mean alone is the same."
    if other["beyond"] <= 0:
        return f"It costs   Nothing: the best by the mean alone ({ms(other['deadline'])} ms) is no better."
    more = with_ends(other, "beyond", ".4f")
    return f"It costs   QoC {more}: what the best by the mean alone ({ms(other['deadline'])} ms) has more."


def _judged_on(advice: Advice) -> list[str]:
    """Robot, edge and network."""
    setup = advice.setup
    robots = f"{setup['robots']} robot{'' if setup['robots'] == 1 else 's'}"
    law = _LAWS.get(setup["controller"], setup["controller"])
    return [
        f"Judged on  {robots} of radius {setup['robot_radius']:g} m, at most {setup['v_max']:.3g} m/s and "
        f"{setup['omega_max']:.3g} rad/s, with {law}, runs of {setup['horizon']:g} s, "
        f"{advice.seeds['fresh']} seeds; network {advice.network.get('name', '')}.",
        f"           {advice.capacity}",
        *([f"           NOTE: {advice.trace}"] if advice.trace else []),
    ]


def _assumptions(advice: Advice) -> list[str]:
    """What changes if an assumption is wrong, what matters most first."""
    lines, gain = [], advice.actuation.gain.given
    for k, row in enumerate(advice.assumptions.to_dict("records")):
        begin = "HANGS ON  " if k == 0 else "  and less on"
        lines += [f"{begin} {row['what']}: {row['assumed']}.",
                  f"           If instead {row['instead']}: QoC {with_ends(row, 'qoc', '.4f')}"
                  f"{with_collisions(row, 'collisions in')}."]  # fmt: skip
        if row["what"] == "when commands take effect":
            lines[-1] = (f"{lines[-1][:-1]}; the best deadline is then {ms(advice.actuation.best_deadline)} ms "
                         f"({gain.mean:+.4f} [{gain.low:+.4f}, {gain.high:+.4f}]).")  # fmt: skip
    return lines


def _question(deadline: str, given: Given) -> str:
    """What is asked of the present deadline, or of the one that is assumed."""
    if given.deadline:
        return f"IS {deadline} ms ACCEPTABLE?"
    return f"DEADLINE not given: {deadline} ms assumed (advise.deadline_ms=... asks for another). IS THAT ACCEPTABLE?"


def present_lines(advice: Advice, given: Given) -> list[str]:
    """Whether the present deadline is acceptable, with the present gains."""
    margin, now, rest = advice.current_margin, advice.judged.iloc[0], advice.judged.iloc[1]
    close = ALONE if is_alone(now["collision_high"]) else f"{collisions_text(now)} of its runs collide"
    target = advice.target.text
    so = {"alone": "this", "kept": "this, and collisions in the limit,",
          "not shown": "this, and collisions not shown to break it,",
          "broken": "this, but not collisions in the limit,"}[safety_of(advice, margin)]  # fmt: skip
    where = (
        f"{so} from {bound_text(margin.low)} to {bound_text(margin.high)} ms"
        if margin.reached
        else f"at no deadline; the best is {margin.best_text}"
    )
    answers = {
        "yes": f"YES: {close}, and {target}.",
        "yes: hardly matters": f"YES: {close}; QoC is lower than it could be, but by an AUC that hardly matters.",
        "no: collisions": f"NO: {close}, {advice.max_collision_share:.1%} are allowed.",
        "no: target": f"NO: asked is that {target}; with {given.of_gains} {where}.",
        "not shown": f"NOT SHOWN: {close}; the upper end breaks {advice.max_collision_share:.1%}.",
    }  # fmt: skip
    return [
        f"{_question(ms(now['deadline']), given)} {answers[advice.acceptable]}",
        f"  {_POLICIES[advice.policy]}. {ms(rest['deadline'])} ms would change QoC by "
        f"{with_ends(rest, 'gain', '+.4f')}.",
    ]
