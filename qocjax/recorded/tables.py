"""Tables of recorded runs: a row per run, per robot, per loop trace and per finding."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from qocjax.network.completion import completes
from qocjax.quality import QocScale, qoc
from qocjax.recorded.findings import CAUSES
from qocjax.recorded.limits import RobotLimits
from qocjax.recorded.loops import LoopTrace
from qocjax.recorded.run import RecordedRun

__all__ = [
    "findings_table",
    "limits_row",
    "loop_row",
    "percentile",
    "reliability_table",
    "robot_table",
    "run_table",
    "scale_of",
]

PERCENTILES = (50, 95, 99)

Label = dict[str, str | float]


def scale_of(runs: Sequence[RecordedRun]) -> QocScale | None:
    """J_med and J_max over all robots of all runs; None for fewer than two AUCs, which say nothing of each other."""
    every = np.concatenate([run.quality.auc for run in runs if run.quality is not None] or [np.empty(0)])
    every = every[np.isfinite(every)]
    return QocScale.of(every) if every.size > 1 and np.median(every) > 0.0 else None


def run_table(runs: Sequence[RecordedRun], labels: Sequence[Label], scale: QocScale | None) -> pd.DataFrame:
    """A row per run: its labels, means over its robots, its loops, and how often each cause was found."""
    rows = []
    for run, label in zip(runs, labels, strict=True):
        rows.append({
            "run": run.name, **label, "format": run.format, "begins": _iso(run.begins), "recorded": run.duration,
            **_quality(run, scale), **loop_row([run.loops[name] for name in run.loops]), **_commands(run),
            **_latency(run), **_late(run),
            "offered_qos": _qos(run),
            **{f"found_{cause}": run.findings.total(cause) for cause in CAUSES},
            "notes": "; ".join(run.findings.notes),
        })  # fmt: skip
    return pd.DataFrame(rows)


def robot_table(runs: Sequence[RecordedRun], labels: Sequence[Label], scale: QocScale | None) -> pd.DataFrame:
    """A row per run and robot."""
    rows = []
    for run, label in zip(runs, labels, strict=True):
        judged = run.quality
        robots = dict.fromkeys([*(judged.robots if judged else ()), *run.commands, *run.loops, *run.limits])
        for robot in robots:
            row: dict = {"run": run.name, **label, "robot": robot}
            if judged is not None and robot in judged.robots:
                k = judged.robots.index(robot)
                row |= {
                    "auc": judged.auc[k],
                    "path_length": judged.path_length[k],
                    "arrival_time": judged.arrival_time[k],
                }
                row["qoc"] = float(qoc(judged.auc[k], scale)) if scale else np.nan
            if robot in run.commands:
                row |= {f"command_{name}": value for name, value in vars(run.commands[robot]).items()}
            if robot in run.limits:
                row |= limits_row(run.limits[robot])
            if robot in run.loops:
                row |= loop_row([run.loops[robot]])
            rows.append(row)
    return pd.DataFrame(rows)


def limits_row(seen: RobotLimits) -> dict:
    """What a robot was seen to do, in SI units: each part's numbers behind its name, and the caps that follow."""
    parts = {"told": seen.commanded, "drove": seen.driven, "": seen.accelerations, "footprint": seen.footprint,
             "nearest": seen.nearest}  # fmt: skip
    row = {
        "_".join(filter(None, (part, name))): value
        for part, each in parts.items() if each is not None for name, value in vars(each).items()
    }  # fmt: skip
    return row | {"seen_v_max": seen.v_max, "seen_omega_max": seen.omega_max}


def findings_table(runs: Sequence[RecordedRun]) -> pd.DataFrame:
    """A row per run, place and cause, with what was done."""
    rows = [
        {"run": run.name, "where": found.where, "cause": found.cause, "count": found.count, "done": CAUSES[found.cause]}
        for run in runs
        for found in run.findings
    ]
    return pd.DataFrame(rows, columns=["run", "where", "cause", "count", "done"])


def reliability_table(trace: LoopTrace, deadlines_ms: Sequence[float]) -> pd.DataFrame:
    """F(Δ) of a trace, and the longest run of loops that miss each deadline."""
    loop = trace.table["loop_time"].to_numpy()
    rows = []
    for deadline in deadlines_ms:
        completed = completes(loop, deadline / 1e3)
        rows.append(
            {"deadline": deadline / 1e3, "reliability": completed.mean(), "longest_miss_run": _longest(~completed)}
        )
    return pd.DataFrame(rows)


def percentile(values: ArrayLike, level: float) -> float:
    """The smallest value that a share of the values (%) does not exceed, as F(Δ) has it; `advise` means the same."""
    return float(np.percentile(np.asarray(values, np.float64), level, method="inverted_cdf"))


def _longest(flags: np.ndarray) -> int:
    return int(_lengths(flags).max(initial=0))


def _lengths(flags: np.ndarray) -> np.ndarray:
    """Lengths of the runs of what is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return edges[1::2] - edges[::2]


def _iso(epoch: float | None) -> str:
    return "" if epoch is None else datetime.fromtimestamp(epoch, UTC).isoformat(timespec="milliseconds")


def _quality(run: RecordedRun, scale: QocScale | None) -> dict:
    judged = run.quality
    if judged is None:
        return {}
    return {
        "robots": len(judged.robots), "began": judged.began, "duration": judged.duration, "auc": _mean(judged.auc),
        "qoc": _mean(np.asarray(qoc(judged.auc, scale))) if scale else np.nan, "min_distance": judged.min_distance,
        "collided": judged.collided, "path_length": judged.path_length.mean(),
        "arrival_time": judged.arrival_time.max(),
        "goal": " | ".join(f"{x:.4g} {y:.4g}" for x, y in np.reshape(judged.goal, (-1, 2)) if np.isfinite(x + y)),
    }  # fmt: skip


def _mean(values: np.ndarray) -> float:
    """Mean of the defined values."""
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if defined.size else float("nan")


def loop_row(traces: Sequence[LoopTrace]) -> dict:
    """Loops of some robots together; delays in s."""
    if not traces:
        return {}
    table = pd.concat([trace.table for trace in traces], ignore_index=True)
    uplink = [trace.lost_uplink for trace in traces]
    row = {
        "loops": len(table), "lost": int(table["lost"].sum()), "lost_share": table["lost"].mean(),
        "lost_uplink": None if None in uplink else sum(n or 0 for n in uplink),
        "longest_lost_run": max(_longest(trace.table["lost"].to_numpy()) for trace in traces),
        "lost_runs": sum(_lengths(trace.table["lost"].to_numpy()).size for trace in traces),
        "period": table.groupby("session")["source_stamp"].diff().median(),
    }  # fmt: skip
    arrived = table[~table["lost"]]
    for name, column in (("loop", "loop_time"), ("uplink", "uplink"), ("compute", "compute"), ("downlink", "downlink")):
        values = arrived[column].dropna()
        if len(values):
            row |= {f"{name}_p{p}": percentile(values, p) for p in PERCENTILES}
    clocks = [clock for trace in traces for clock in trace.clocks]
    if clocks:
        row["clock_stretches"] = len(clocks)
        row["clock_uncertainty"] = float(np.median([clock.uncertainty for clock in clocks]))
        row["clock_drift_ppm"] = 1e6 * float(np.median([clock.drift for clock in clocks]))
        row["parts_share"] = float(table.loc[~table["lost"], "uplink"].notna().mean())
    return row


def _commands(run: RecordedRun) -> dict:
    reports = list(run.commands.values())
    if not reports:
        return {}
    return {
        "commands": sum(each.count for each in reports),
        "command_period": float(np.median([each.period for each in reports])),
        "command_gaps": sum(each.gaps for each in reports),
        "longest_command_gap": max(each.longest_gap for each in reports),
        "hold_share": float(np.mean([each.hold_share for each in reports])),
        "driving_hold_time": sum(each.driving_hold_time for each in reports),
    }


def _latency(run: RecordedRun) -> dict:
    """Mean over the robots, with the widest interval's half."""
    if not run.latency:
        return {}
    every = list(run.latency.values())
    return {
        "command_to_motion": float(np.mean([each.delay for each in every])),
        "command_to_motion_half": max(each.high - each.delay for each in every),
    }


def _late(run: RecordedRun) -> dict:
    if not run.late:
        return {}
    every = np.concatenate(list(run.late.values()))
    return {f"pose_late_p{p}": percentile(every, p) for p in PERCENTILES}


def _qos(run: RecordedRun) -> str:
    groups: dict[str, list[str]] = {}
    for topic, words in run.qos.items():
        groups.setdefault(words or "not recorded", []).append(topic)
    return "; ".join(f"{words}: {' '.join(sorted(topics))}" for words, topics in groups.items())
