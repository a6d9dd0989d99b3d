"""A recorded run as a few lines for a terminal."""

from __future__ import annotations

import numpy as np

from qocjax.recorded.commands import CommandReport
from qocjax.recorded.judge import Quality
from qocjax.recorded.latency import Latency
from qocjax.recorded.limits import RobotLimits, Speeds
from qocjax.recorded.loops import LoopTrace
from qocjax.recorded.nearest import Nearest
from qocjax.recorded.run import RecordedRun
from qocjax.recorded.tables import PERCENTILES, loop_row, percentile

__all__ = ["limit_lines", "nearest_text", "run_lines"]

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
    lines += [line for robot, seen in run.limits.items() for line in limit_lines(robot, seen)]
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
        f"  commands of {robot}: {report.count}, one in {1e3 * report.period:.4g} ms (5 and 95 %: "
        f"{1e3 * report.period_low:.4g}, {1e3 * report.period_high:.4g} ms), {report.gaps} gaps (longest "
        f"{report.longest_gap:.3g} s), on hold {report.hold_share:.1%}"
    )


def _latency_line(robot: str, latency: Latency) -> str:
    low, high = 1e3 * latency.low, 1e3 * latency.high
    return (
        f"  {robot}: moves {1e3 * latency.delay:.0f} ms [{low:.0f}, {high:.0f}] after its commands are recorded "
        f"(estimated from their correlation, {latency.correlation:.2f}; the robot's own response is part of it)"
    )


def limit_lines(robot: str, seen: RobotLimits) -> list[str]:
    """What a robot was seen to do, which it can do at least."""
    lines = [
        f"{name}: {_speeds_text(each)}"
        for name, each in (("told to drive", seen.commanded), ("drove", seen.driven))
        if each is not None
    ]
    if (found := seen.accelerations) is not None:
        numbers = ", ".join(
            f"{name} {'none' if (value := getattr(found, name)) is None else f'{value:.3g} {unit}'}"
            for name, unit in (("ax_max", "m/s²"), ("ax_min", "m/s²"), ("az_max", "rad/s²"))
        )
        lines.append(f"{numbers}: 99 % of the slopes of its speeds over {found.window:.3g} s that are clear of noise "
                     f"({found.ax_noise:.2g} m/s², {found.az_noise:.2g} rad/s²)")  # fmt: skip
    if (outline := seen.footprint) is not None:
        centre = {"base": "in its own frame", "pose": "about its pose", "middle": "about the middle of its area"}
        lines.append(f"footprint of {outline.corners} corners, {centre[outline.centre]}: within {outline.radius:.3g} "
                     f"m, around {outline.inscribed:.3g} m (a costmap's has its padding in it)")  # fmt: skip
    caps = ", ".join(f"{name} {value:.3g} {unit}" for name, value, unit in (("v_max", seen.v_max, "m/s"),
                     ("omega_max", seen.omega_max, "rad/s")) if value is not None)  # fmt: skip
    if caps:
        nearest = "" if seen.nearest is None else f"; {nearest_text(seen.nearest)}"
        lines.append(f"it can do at least {caps}, as it was seen to{nearest}")
    return [f"  {robot}: {text}" for text in lines]


def _speeds_text(each: Speeds) -> str:
    if not max(each.forward, each.backward, each.turn):
        return "nowhere, it stands"
    return (
        f"up to {each.forward:.3g} m/s forwards, {each.backward:.3g} m/s backwards, {each.turn:.3g} rad/s (99 %; at "
        f"most {each.forward_max:.3g}, {each.backward_max:.3g}, {each.turn_max:.3g})"
    )


def nearest_text(nearest: Nearest) -> str:
    """The preset that a robot is like, and how far from it."""
    apart = ", ".join(
        f"{name} {share:+.0%}"
        for name, share in (("v_max", nearest.v_max), ("omega_max", nearest.omega_max), ("radius", nearest.radius))
        if share is not None
    )
    return f"nearest preset: {'' if nearest.near else 'none is near, the least far '}robot={nearest.name} ({apart})"
