"""One recorded run: what is read of its files, and what that says about loops, commands and quality of control."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from qocjax.recorded.command_loops import command_loops
from qocjax.recorded.commands import CommandReport, report_commands
from qocjax.recorded.content import read_bag
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats import FORMATS, read_log
from qocjax.recorded.judge import Quality, Yardstick
from qocjax.recorded.latency import Latency, command_to_motion
from qocjax.recorded.limits import RobotLimits, limits_of
from qocjax.recorded.loops import ClockRules, LoopTrace, loop_trace
from qocjax.recorded.nearest import Preset
from qocjax.recorded.pose_tables import PosesFormat
from qocjax.recorded.poses import quality
from qocjax.recorded.series import Cleaning, clean
from qocjax.recorded.silence import silences, tell_silences
from qocjax.recorded.stamps import StampsFormat, read_stamps
from qocjax.recorded.topics import BagContent, TopicPatterns, read_pose_table

__all__ = ["RecordedRun", "Rules", "RunFiles", "read_run"]

_STAMPED = "geometry_msgs/msg/TwistStamped"


@dataclass(frozen=True)
class RunFiles:
    """Where a run lies."""

    name: str
    bag: Path | None = None
    poses: Path | None = None  # table
    stamps: tuple[tuple[Path, Path | None], ...] = ()  # tables of stamps, each with the edge's own if there is one
    log: tuple[Path, str] | None = None  # of a tool, and its format
    fault: str = ""  # why nothing of it can be read

    @property
    def ending(self) -> str:
        """That of its file, where it is one."""
        files = [each[0] for each in (*self.stamps, self.log or (None,))] + [self.poses]
        return next(("".join(file.suffixes) for file in files if file is not None), "")


@dataclass(frozen=True)
class Rules:
    """How runs are read and judged."""

    topics: TopicPatterns
    stamps: StampsFormat = field(default_factory=StampsFormat)
    clock: ClockRules = field(default_factory=ClockRules)
    cleaning: Cleaning = field(default_factory=Cleaning)
    yardstick: Yardstick = field(default_factory=Yardstick)
    commands_on_robot_clock: bool = True  # whether what recorded a TwistStamped command ran on the clock of its stamp
    poses: PosesFormat = field(default_factory=PosesFormat)
    kind: str = "auto"  # format of logs: `auto`, or one of `FORMATS`
    presets: tuple[Preset, ...] = ()  # robots that a recorded one may be


@dataclass(frozen=True)
class RecordedRun:
    """What came out of a run's files."""

    name: str
    begins: float | None  # s, epoch of the first message or loop
    duration: float  # s
    loops: dict[str, LoopTrace]  # by robot
    commands: dict[str, CommandReport]  # by robot
    quality: Quality | None
    late: dict[str, np.ndarray]  # by topic: delay above the envelope of the clock, s; the constant part is not known
    qos: dict[str, str]  # offered, by topic
    findings: Findings
    format: str = ""  # what kind of file it was read from, where that is a tool's
    one_way: dict[str, np.ndarray] = field(default_factory=dict)  # delays of one direction, s, inf where lost
    latency: dict[str, Latency] = field(default_factory=dict)  # from commands to motion, by robot
    limits: dict[str, RobotLimits] = field(default_factory=dict)  # what robots were seen to do, by robot
    computed: bool = True  # whether its loops hold a computation, which those of a log of the network alone do not


def read_run(files: RunFiles, rules: Rules, *, quiet: bool = False) -> RecordedRun:
    """Reads one run.

    Args:
        files: Where it lies.
        rules: How it is read and judged.
        quiet: No progress bar.

    Raises:
        ValueError: A file is not there, is not of its format, or holds nothing of what is looked for.
    """
    if files.fault:
        raise ValueError(files.fault)
    findings = Findings()
    if files.log is not None:
        return _from_log(files.name, *files.log, rules, findings)
    loops = _stamp_loops(files, rules, findings)
    content = None
    if files.bag is not None:
        content = read_bag(files.bag, rules.topics, findings, quiet=quiet)
    elif files.poses is not None:
        content = read_pose_table(files.poses, findings, rules.topics.only, rules.poses)
    if content is None:
        return RecordedRun(files.name, *_span(loops), loops, {}, None, {}, {}, findings)
    return _from_content(files.name, content, loops, rules, findings)


def _span(loops: dict[str, LoopTrace]) -> tuple[float | None, float]:
    """When the first loop began (s, None where that is not known), and how long they took (s, NaN likewise)."""
    known = [trace for trace in loops.values() if trace.table["source_stamp"].notna().any()]
    if not known:
        return None, float("nan")
    first = min(trace.epoch for trace in known)
    return first or None, max(trace.epoch + float(trace.table["source_stamp"].max()) for trace in known) - first


def _from_log(name: str, path: Path, kind: str, rules: Rules, findings: Findings) -> RecordedRun:
    """What the log of a tool says."""
    log = read_log(path, kind, findings, rules.stamps.unit)
    for note in log.notes:
        findings.note(note)
    loops = {}
    if log.parts:
        trace = loop_trace(log.parts, path.name, rules.clock, rules.cleaning, findings, log.period)
        lost = trace.lost_uplink if log.lost_uplink is None else log.lost_uplink
        loops["loops"] = replace(trace, lost_uplink=lost)
    one_way = {} if log.one_way is None else {"one_way": log.one_way}
    return RecordedRun(
        name, *_span(loops), loops, {}, None, {}, {}, findings, FORMATS[kind].TITLE, one_way,
        computed=log.computed,
    )  # fmt: skip


def _from_content(
    name: str, content: BagContent, loops: dict[str, LoopTrace], rules: Rules, findings: Findings
) -> RecordedRun:
    """Adds what a bag's poses and commands say."""
    where = {robot: content.topics[robot][1] or f"commands of {robot}" for robot in content.commands}
    cleaned = {
        part: {
            robot: clean(raw, content.begin, name_of(robot), rules.cleaning, findings) for robot, raw in raws.items()
        }
        for part, raws, name_of in (
            ("poses", content.poses, lambda robot: content.topics[robot][0]),
            ("odometry", content.odometry, lambda robot: f"odometry of {robot}"),
            ("commands", content.commands, where.__getitem__),
        )
    }
    poses, odometry, commands = cleaned["poses"], cleaned["odometry"], cleaned["commands"]
    if not poses:
        findings.note("no quality: no topic has poses")
    reports = {robot: report_commands(each, where[robot], rules.cleaning, findings) for robot, each in commands.items()}
    latency: dict[str, Latency] = {}
    given = set(loops)
    for robot, each in commands.items():
        states = [part[robot] for part in (odometry, poses) if robot in part]
        if each.kind == _STAMPED and robot not in loops:
            trace = command_loops(
                robot, each, states, where[robot], rules.commands_on_robot_clock, findings, content.begin
            )
            loops |= {robot: trace} if trace is not None else {}
        found = command_to_motion(each, states[0]) if states else None
        latency |= {robot: found} if found is not None else {}
        if found is None and robot not in loops and states:
            findings.note(
                f"{where[robot]}: no delay between commands and motion can be estimated, as commands change too seldom "
                "or do not explain the motion"
            )
    poses = {robot: each for robot, each in poses.items() if each.time.size > 1}
    first = min((float(each.record.min()) for each in commands.values() if each.record.size), default=None)
    judged = None
    if poses:
        judged = quality(poses, rules.yardstick, rules.cleaning, findings, first, odometry, content.goals)
    every = [each for part in (poses, odometry, commands) for each in part.values()]
    own = {robot: trace for robot, trace in loops.items() if robot not in given}
    duration = 1e-9 * (content.end - content.begin)
    tell_silences(name, silences(every, rules.cleaning), duration, judged, own, rules.yardstick.weights, findings)
    late = {content.topics[robot][0]: each.late[np.isfinite(each.late)] for robot, each in poses.items()}
    return RecordedRun(
        name, 1e-9 * content.begin or None, 1e-9 * (content.end - content.begin), loops,
        {robot: report for robot, report in reports.items() if report is not None}, judged,
        {topic: values for topic, values in late.items() if values.size}, content.qos, findings, latency=latency,
        limits=limits_of(content, commands, [poses, odometry], rules.cleaning, rules.presets, findings),
    )  # fmt: skip


def _stamp_loops(files: RunFiles, rules: Rules, findings: Findings) -> dict[str, LoopTrace]:
    """Traces of the run's tables of stamps, by robot; of a table without names, the file's."""
    loops = {}
    for path, edge in files.stamps:
        parts = read_stamps(path, rules.stamps, edge, findings)
        robots = dict.fromkeys(part.robot for part in parts)
        for robot in robots:
            own = [part for part in parts if part.robot == robot]
            label = robot or ("loops" if len(files.stamps) == 1 else re.sub(r"\W+", "_", path.stem))
            where = f"{path.name}, {robot}" if robot else path.name
            loops[label] = loop_trace(own, where, rules.clock, rules.cleaning, findings)
    return loops
