"""A recorded run as a few lines for a terminal."""

from __future__ import annotations

import numpy as np

from qocjax.recorded.commands import CommandReport
from qocjax.recorded.judge import Quality
from qocjax.recorded.latency import Latency
from qocjax.recorded.loops import LoopTrace
from qocjax.recorded.run import RecordedRun
from qocjax.recorded.tables import PERCENTILES, loop_row, percentile

__all__ = ["run_lines"]

_PARTS = ("loop_time", "uplink", "compute", "downlink")


def run_lines(run: RecordedRun, qoc: float | None) -> list[str]:
    """What came out of a run, and every finding.

    Args:
        run: The run.
        qoc: Its QoC; None or NaN where there is none.
    """
    known = [] if np.isnan(run.duration) else [f"{run.duration:.4g} s"]
    lines = [f"{run.name}  ({', '.join(([run.format] if run.format else []) + known) or 'no times'})"]
    if run.quality is not None:
        lines.append(_quality_line(run.quality, qoc))
    for robot, trace in run.loops.items():
        lines += _loop_lines(robot, trace)
    lines += [_one_way_line(delays) for delays in run.one_way.values()]
    for topic, late in run.late.items():
        median, most = (round(1e3 * percentile(late, p), 6) for p in (50, 99))
        lines.append(f"  {topic}: {median:.3g} ms (99 %: {most:.3g} ms) later than its quickest")
    lines += [_command_line(robot, report) for robot, report in run.commands.items()]
    lines += [_latency_line(robot, each) for robot, each in run.latency.items()]
    lines += [f"  offered QoS of {topic}: {words or 'not recorded'}" for topic, words in run.qos.items()]
    lines += [f"  found {found.count} {found.cause} in {found.where}" for found in run.findings]
    return lines + [f"  note: {text}" for text in run.findings.notes]


def _quality_line(judged: Quality, qoc: float | None) -> str:
    goals = " | ".join(f"{x:.3f} {y:.3f}" for x, y in np.reshape(judged.goal, (-1, 2)))
    goals = f"goal ({goals})" if np.isfinite(judged.goal).all() else "no goal"
    robots = ", ".join(
        f"{name}: {'no AUC' if np.isnan(auc) else f'AUC {auc:.4g} s'}, path {length:.2f} m"
        for name, auc, length in zip(judged.robots, judged.auc, judged.path_length, strict=True)
    )
    apart = f"; smallest distance {judged.min_distance:.3g} m" if np.isfinite(judged.min_distance) else ""
    score = "" if qoc is None or np.isnan(qoc) else f"; QoC {qoc:.4f}"
    return f"  {judged.duration:.4g} s judged, {goals}: {robots}{apart}{score}"


def _loop_lines(robot: str, trace: LoopTrace) -> list[str]:
    table = trace.table
    parts = []
    for name in _PARTS:
        values = table.loc[~table["lost"], name].dropna()
        if len(values):
            numbers = "/".join(f"{1e3 * percentile(values, p):.4g}" for p in PERCENTILES)
            parts.append(f"{name.replace('_', ' ')} {numbers}")
    shares = "/".join(map(str, PERCENTILES))
    lines = [f"  {robot}: {len(table)} loops, {int(table['lost'].sum())} lost; ms at {shares} %: {', '.join(parts)}"]
    if (text := _rhythm(trace)) is not None:
        lines.append(f"    {text}")
    if trace.clocks:
        worst = 1e3 * max(clock.uncertainty for clock in trace.clocks)
        drift = 1e6 * float(np.median([clock.drift for clock in trace.clocks]))
        lines.append(f"    edge's clock known within {worst:.3g} ms, drifts by {drift:.3g} ppm")
    return lines


def _rhythm(trace: LoopTrace) -> str | None:
    """How often loops were measured, and how losses hang together."""
    row = loop_row([trace])
    period, parts = row["period"], []
    if np.isfinite(period):
        parts.append(f"one in {1e3 * period:.4g} ms")
    if row["lost"]:
        parts.append(f"losses in {row['lost_runs']} bursts of {row['lost'] / row['lost_runs']:.3g}, the longest of "
                     f"{row['longest_lost_run']}")  # fmt: skip
    if row.get("lost_uplink") is not None and row["lost"] and trace.lost_uplink is not None:
        parts.append(f"{trace.lost_uplink} on the way up")
    return "; ".join(parts) if parts else None


def _one_way_line(delays: np.ndarray) -> str:
    arrived = delays[np.isfinite(delays)]
    numbers = "/".join(f"{1e3 * percentile(arrived, p):.4g}" for p in PERCENTILES)
    return f"  {delays.size} messages one way, {delays.size - arrived.size} lost; ms at 50/95/99 %: {numbers}"


def _command_line(robot: str, report: CommandReport) -> str:
    return (
        f"  commands of {robot}: {report.count}, one in {1e3 * report.period:.4g} ms, {report.gaps} gaps (longest "
        f"{report.longest_gap:.3g} s), on hold {report.hold_share:.1%}"
    )


def _latency_line(robot: str, latency: Latency) -> str:
    low, high = 1e3 * latency.low, 1e3 * latency.high
    return (
        f"  {robot}: moves {1e3 * latency.delay:.0f} ms [{low:.0f}, {high:.0f}] after its commands are recorded "
        f"(estimated from their correlation, {latency.correlation:.2f}; the robot's own response is part of it)"
    )
