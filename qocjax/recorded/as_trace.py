"""A recorded file as a network: what `network=trace` reads where no column is named."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from qocjax.network import Constant, LoopNetwork, Network, Trace
from qocjax.network.period import period_of
from qocjax.recorded.folder import find_runs
from qocjax.recorded.loops import ClockRules
from qocjax.recorded.nearest import Preset
from qocjax.recorded.run import RecordedRun, Rules, read_run
from qocjax.recorded.stamps import StampsFormat
from qocjax.recorded.topics import TopicPatterns

__all__ = ["network_of", "read_file", "trace_of"]


def read_file(
    path: str | Path,
    unit: str | None = None,
    gaps_are_lost: bool = False,
    topics: TopicPatterns | None = None,
    presets: tuple[Preset, ...] = (),
) -> RecordedRun:
    """Reads a log of a tool, a table of loops or a bag by what is in it.

    Args:
        path: The file.
        unit: Of times that the file says no unit of: s, ms, us or ns.
        gaps_are_lost: Whether numbers that are not there are lost loops.
        topics: Of a bag; None refuses bags.
        presets: Robots that the one of a bag may be.

    Raises:
        ValueError: It is none of the formats that are known, or cannot be read.
    """
    stamps = StampsFormat(unit=unit)
    runs = find_runs(Path(path), stamps)
    bags = [each for each in runs if each.bag is not None]
    if len(runs) != 1 or (Path(path).is_dir() and not bags) or (bags and topics is None):
        raise ValueError(
            f"{path}: holds {len(runs)} runs, {len(bags)} of them bags, expected one bag, the log of a tool, or a "
            "trace of `python -m qocjax.ingest`"
        )
    (files,) = runs
    rules = Rules(topics or TopicPatterns((), ()), stamps, ClockRules(missing_are_lost=gaps_are_lost), presets=presets)
    return read_run(files, rules, quiet=True)


def network_of(run: RecordedRun, source: str, period: float | None = None) -> Network:
    """The loops of a run as a network; of a bag without stamps of loops its delay from commands to motion.

    Warns, as `trace_of`, and of what a constant delay leaves out.

    Args:
        run: One that has the loops of one robot, or whose commands explain the motion of one.
        source: Of the run, for the record.
        period: Between two loops (s); None for that of the send times.

    Raises:
        ValueError: It has neither.
    """
    if run.loops or len(run.latency) != 1:
        return trace_of(run, source, period)
    (found,) = run.latency.values()
    warnings.warn(
        f"{source}: has no stamps of loops; every loop takes {1e3 * found.delay:.0f} ms [{1e3 * found.low:.0f}, "
        f"{1e3 * found.high:.0f}], the delay from its commands to the motion: how it varies, what is lost is unknown",
        stacklevel=2,
    )
    return LoopNetwork(compute=Constant(round(found.delay, 4)), name=f"{run.name}, commands to motion")


def trace_of(run: RecordedRun, source: str, period: float | None = None) -> Trace:
    """The loops of a run as a network, with the period of their send times.

    Warns of what was found in the file, and where nothing tells the period.

    Args:
        run: One that has the loops of one robot.
        source: Of the run, for the record.
        period: Between two loops (s); None for that of the send times.

    Raises:
        ValueError: It has no loops, or those of several robots.
    """
    if len(run.loops) != 1:
        several = ", as python -m qocjax.ingest writes for each" if run.loops else ""
        raise ValueError(f"{source}: {_without_loops(run)}; expected the loop times of one robot{several}")
    (trace,) = run.loops.values()
    found = [f"{each.count} {each.cause}" for each in run.findings]
    if found:
        warnings.warn(f"{source}: found {', '.join(found)}", stacklevel=2)
    table, origin = trace.table, "given"
    if period is None:
        times = table["source_stamp"].to_numpy(float)
        period = period_of(times, table["sequence"].to_numpy(float))
        origin = "" if period is None else "its send times"
    if period is None:
        warnings.warn(
            f"{source}: nothing tells how often loops were measured, a row is taken for each sampling period; expected "
            "network.period (s)", stacklevel=2,
        )  # fmt: skip
    label = f"{source} ({run.format})" if run.format else source
    return Trace(np.asarray(table["loop_time"], float), run.name, period, label, origin)


def _without_loops(run: RecordedRun) -> str:
    """Why a run does not have the loops of one robot."""
    if run.loops:
        return f"holds the loops of {len(run.loops)} robots, {', '.join(run.loops)}"
    if run.latency:
        return f"holds the delays from commands to motion of {len(run.latency)} robots, {', '.join(run.latency)}"
    if run.limits and not run.commands:
        return "holds no commands, whose stamps or motion tell how long loops take"
    return "; ".join(run.findings.notes) or "holds the loops of 0 robots"
