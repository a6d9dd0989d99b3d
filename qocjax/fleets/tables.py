"""What a fleet study found, as tables, and what follows from it in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from qocjax.fleets.limits import Asked, Crossing, crossing, keeps, largest_fleet
from qocjax.fleets.point import Point
from qocjax.network.edge import Edge
from qocjax.quality import QocScale
from qocjax.statistics.collisions import ALONE, is_alone
from qocjax.statistics.estimates import paired
from qocjax.statistics.together import told_apart
from qocjax.study.capacity import edge_text

__all__ = ["FleetStudy", "answers", "collision_text", "map_table", "need_table", "points_table", "steps_table"]

_FULL = 0.95  # of what it can serve: what is offered as much has no room left for chance
_SAME = 0.01  # of what there is: by less, use tells nothing of the fleet
USES = ("uplink_usage", "edge_usage", "downlink_usage")


@dataclass(frozen=True)
class FleetStudy:
    """What was found; scores are on fresh seeds."""

    points: pd.DataFrame  # a row per fleet
    completion: pd.DataFrame  # F over the deadline for each fleet
    maps: dict[str, pd.DataFrame]  # by what is given: `prbs`, `workers`; a row per fleet and amount
    needs: dict[str, pd.DataFrame]  # how much of it each fleet needs
    steps: pd.DataFrame  # gain of one step of each, at one fleet
    asked: Asked
    largest: int | None  # fleet that keeps what is asked
    limit: Crossing  # where QoC passes the target, between fleets
    scale: QocScale
    edge: Edge | None = None  # of the network
    absolute: bool = False  # whether the target was given as a QoC, on the scale of this study alone


def points_table(points: Sequence[Point]) -> pd.DataFrame:
    """A row per fleet."""
    return pd.DataFrame([point.row for point in points])


def map_table(cells: Mapping[tuple[int, int], Point], given: str) -> pd.DataFrame:
    """A row per fleet and amount of what it is given."""
    return pd.DataFrame([{"robots": n, given: amount} | point.row for (n, amount), point in cells.items()])


def need_table(cells: Mapping[tuple[int, int], Point], given: str, asked: Asked) -> pd.DataFrame:
    """How much of something each fleet needs for the QoC that is asked, with its interval.

    `need` is the least amount simulated that keeps all that is asked; `crossing` lies between amounts, where QoC alone
    passes its target. Either is NaN where the axis does not hold it.
    """
    rows = []
    for robots in dict.fromkeys(n for n, _ in cells):
        amounts = [amount for n, amount in cells if n == robots]
        here = [cells[robots, amount] for amount in amounts]
        # QoC rises with what is given: from the other end it falls.
        scores = [point.scores for point in here[::-1]]
        found = crossing(1.0 / np.array(amounts[::-1], float), scores, asked.qoc, here[0].units)
        ends = sorted(1.0 / each for each in (found.low, found.high) if each is not None)
        kept = [a for a, p in zip(amounts, here, strict=True) if keeps(p, asked)]
        rows.append({
            "robots": robots, "need": min(kept, default=np.nan),
            "crossing": np.nan if found.value is None else 1.0 / found.value,
            "crossing_low": ends[0] if found.high is not None and ends else np.nan,
            "crossing_high": ends[-1] if found.low is not None and ends else np.nan,
            "beyond": {"below": "more than the axis", "above": "less than the axis"}.get(found.beyond, ""),
        })  # fmt: skip
    return pd.DataFrame(rows)


def steps_table(base: Point, steps: Mapping[str, Point]) -> pd.DataFrame:
    """Gain of each step over the base at the same number of robots, paired by seed.

    First is the step that gains most on the selection seeds; the gains are those of the evaluation seeds, so that the
    first one's does not flatter itself. `gain_told` is the sign of those that are told from 0, all together at 95 %.
    """
    rows = []
    for name, point in steps.items():
        gap = paired(point.scores, base.scores, units=point.units)
        rows.append({
            "step": name, "robots": base.robots, "gain": gap.mean, "gain_low": gap.low, "gain_high": gap.high,
            "gain_se": gap.se, "gain_selection": float(point.selection.mean() - base.selection.mean()),
            "qoc": point.row["qoc"], "qoc_se": point.row["qoc_se"], "deadline": point.deadline,
            "reliability": point.row["reliability"], "reliability_se": point.row["reliability_se"],
            "collision_share": point.row["collision_share"],
            **{use: point.row[use] for use in USES if use in point.row},
        })  # fmt: skip
    if not rows:
        return pd.DataFrame()
    table = pd.DataFrame(rows).sort_values("gain_selection", ascending=False, ignore_index=True)
    return table.assign(gain_told=told_apart(table["gain"], table["gain_se"], np.unique(base.units).size))


def find_limit(points: Sequence[Point], asked: Asked) -> tuple[int | None, Crossing]:
    """The largest fleet that keeps what is asked, and where QoC passes its target."""
    robots, scores = [point.robots for point in points], [point.scores for point in points]
    return largest_fleet(points, asked), crossing(robots, scores, asked.qoc, points[0].units)


def answers(study: FleetStudy) -> list[str]:
    """What follows, a sentence or two each."""
    return [_largest(study), *_admission(study), *_limit(study), *_needs(study), *_first(study), *_own_scale(study)]


def _own_scale(study: FleetStudy) -> list[str]:
    """How another study gets the scale that a given target is meant on."""
    if not study.absolute:
        return []
    return [f"The target is a QoC on this study's own J_med and J_max, which another network changes: compare what-ifs "
            f"with fleet.j_med={float(study.scale.median)!r} fleet.j_max={float(study.scale.largest)!r}"]  # fmt: skip


def _largest(study: FleetStudy) -> str:
    asked = (
        f"QoC of at least {study.asked.qoc:.4f} and collisions in at most {study.asked.collision_share:.0%} of the runs"
    )
    if study.largest is None:
        row = study.points.iloc[0]
        found = f"{row['qoc']:.4f} ± {row['qoc_se']:.4f}, {collision_text(row)}"
        return f"No fleet that was simulated keeps a {asked}; N = {row['robots']:g}: {found}."
    rows = study.points.set_index("robots")
    row = rows.loc[study.largest]
    text = f"{_robots(study.largest)} a {asked}: {row['qoc']:.4f} ± {row['qoc_se']:.4f}, {collision_text(row)}."
    text += _unshown(study, rows.loc[: study.largest])
    more = [n for n in rows.index if n > study.largest]
    if not more:
        return text + " That is the largest fleet simulated."
    following = rows.loc[more[0]]
    why = "QoC" if following["qoc"] < study.asked.qoc else "collisions"
    text += f" {more[0]} do not ({why}: {following['qoc']:.4f}, {collision_text(following)})."
    if study.limit.value is not None and study.limit.value >= study.largest:
        ends = f"[{_end(study.limit.low)}, {_end(study.limit.high)}]"
        text += (
            f" On straight lines between fleets, QoC passes the target at {study.limit.value:.3g} {ends} robots "
            "(interval over seeds; where it truly falls, only fleets between those simulated would show)."
        )
    return text


def collision_text(row: Any) -> str:
    """Share of runs with a collision and its interval; of one robot no number."""
    if is_alone(row["collision_high"]):
        return ALONE
    return f"{row['collision_share']:.0%} [{row['collision_low']:.0%}, {row['collision_high']:.0%}]"


def _unshown(study: FleetStudy, fleets: pd.DataFrame) -> str:
    """A sentence where collisions of some fleets keep their limit by their share alone; else nothing."""
    asked = study.asked
    if not (few := asked.not_shown(fleets)).any():
        return ""
    would = f"{asked.least_seeds:g} without one would (fleet.evaluation_seeds)"
    return (
        f" That collisions keep within {asked.collision_share:.0%} is not shown with "
        f"{fleets['seeds'][few].min():g} seeds, {would if np.isfinite(asked.least_seeds) else 'nor with any number'}."
    )


def _admission(study: FleetStudy) -> list[str]:
    """When to admit one more, by what tells a full network from one that is not."""
    if study.largest is None:
        return []
    rows = study.points.set_index("robots")
    row, after = rows.loc[study.largest], rows[rows.index > study.largest]
    admit = f"Admit a robot while there are fewer than {study.largest}{'' if len(after) else ', and maybe more'}"
    text = (
        f"{admit}: with {study.largest}, F({1e3 * row['deadline']:g} ms) = {row['reliability']:.3f}; less of it says "
        "that the network is full, whoever fills it."
    )
    names = {"uplink_usage": "the uplink", "edge_usage": "the edge", "downlink_usage": "the downlink"}
    # Workers that drop what finds them busy are as busy with too many robots as with enough.
    telling = [use for use in USES if use in row and len(after) and after[use].iloc[0] > row[use] + _SAME]
    if telling:
        text += f" So does more than {' or '.join(f'{row[use]:.0%} of {names[use]}' for use in telling)} in use."
    return [text]


def _limit(study: FleetStudy) -> list[str]:
    """What is offered most of what it can serve, at the first fleet that misses what is asked, or the largest one."""
    rows = study.points.set_index("robots", drop=False)
    beyond = rows[rows["robots"] > (study.largest or 0)]
    row = (beyond if len(beyond) else rows.iloc[-1:]).iloc[0]
    loads = {name: row[f"{name}_offered"] for name in ("edge", "uplink", "downlink") if f"{name}_offered" in rows}
    there = [] if study.edge is None else [f"{edge_text(study.edge, int(row['robots']))}."]
    if not loads:
        return there
    most = max(loads, key=lambda name: loads[name])
    words = f"{most}: {_offered(study, most, loads[most])}"
    others = [f"{name} {share:.0%}" for name, share in loads.items() if name != most]
    rest = f"; offered to the others: {', '.join(others)}" if others else ""
    start = f"With N = {row['robots']:g}"
    if loads[most] >= _FULL:
        return [f"{start} limit: {words}, {loads[most]:.0%} of what it can serve{rest}.", *there]
    return [f"{start} nothing is offered as much as it can serve: most is {words}, {loads[most]:.0%} of it{rest}. What "
            "counts is how long loops take and how robots meet.", *there]  # fmt: skip


def _offered(study: FleetStudy, name: str, share: float) -> str:
    if name != "edge" or study.edge is None:
        return f"{share:.0%} of its slots offered"
    workers = f"{study.edge.workers} worker{'' if study.edge.workers == 1 else 's'}"
    erlang = f"{share * study.edge.workers:.3g} erlang"
    return f"{erlang} per robot offered to {workers}" if study.edge.per_robot else f"{erlang} offered to {workers}"


def _needs(study: FleetStudy) -> list[str]:
    whose = "" if study.edge is None else " for each robot" if study.edge.per_robot else ", shared"
    words = {"prbs": "Resource blocks", "workers": f"Workers{whose}"}
    return [
        f"{words[given]}: {'; '.join(map(_need, table.to_dict('records')))}.{_unshown(study, study.maps[given])}"
        for given, table in study.needs.items()
    ]


def _need(row: Mapping[str, Any]) -> str:
    verb = "needs" if row["robots"] == 1 else "need"
    most = "at most " if row["beyond"] == "less than the axis" else ""
    amount = "more than were tried" if np.isnan(row["need"]) else f"{most}{row['need']:g}"
    text = f"{row['robots']} {verb} {amount}"
    if np.isnan(row["crossing"]):
        return text
    ends = f"[{_end(row['crossing_low'])}, {_end(row['crossing_high'])}]"
    return f"{text} (QoC alone, interpolated: {row['crossing']:.3g} {ends})"


def _robots(count: int) -> str:
    return "1 robot keeps" if count == 1 else f"{count} robots keep"


def _end(value: float | None) -> str:
    return "?" if value is None or np.isnan(value) else f"{value:.3g}"


def _first(study: FleetStudy) -> list[str]:
    if study.steps.empty:
        return []
    best = study.steps.iloc[0]
    gain = f"{best['gain']:+.4f} [{best['gain_low']:+.4f}, {best['gain_high']:+.4f}]"
    if best["gain_low"] <= 0:
        return [
            f"With N = {best['robots']} the step that gains most on the seeds of the choice, {best['step']}, "
            f"is not shown to help on fresh ones: {gain} QoC."
        ]
    return [f"With N = {best['robots']} change first: {best['step']}, {gain} QoC."]
