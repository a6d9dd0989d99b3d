"""`python -m qocjax.ingest`: recorded runs to loop traces, quality of control and an account of what was found."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig, OmegaConf

from qocjax.advice.advice import plain
from qocjax.commands.command_line import output_dir
from qocjax.commands.recordings import read_runs
from qocjax.commands.robot_seen import limits_values
from qocjax.config.ingest import IngestConfig
from qocjax.config.part import load
from qocjax.figures.recorded import draw_recorded
from qocjax.quality import QocScale
from qocjax.recorded import RecordedRun, find_runs, read_run
from qocjax.recorded.tables import (
    findings_table,
    reliability_table,
    robot_table,
    run_table,
    scale_of,
)
from qocjax.recorded.text import run_lines
from qocjax.statistics.run_groups import group_table
from qocjax.store import write_config, write_json, write_table, write_text
from qocjax.store.provenance import provenance

__all__ = ["Ingested", "main", "report", "run"]


@dataclass(frozen=True)
class Ingested:
    """What came out of a folder of runs."""

    runs: list[RecordedRun]
    labels: list[dict[str, str | float]]
    scale: QocScale | None
    summary: pd.DataFrame  # a row per run
    robots: pd.DataFrame  # a row per run and robot
    groups: pd.DataFrame | None  # a row per combination of labels, where there are any
    findings: pd.DataFrame  # a row per run, place and cause
    failed: dict[str, str]  # runs that could not be read, and why


def run(config: IngestConfig, folder: Path | None = None, *, quiet: bool = False) -> Ingested:
    """Reads the runs of a configuration.

    A run of several that cannot be read is told and left out; one on its own is an error.

    Args:
        config: What to read, and how.
        folder: Where tables, traces and figures go; None writes nothing.
        quiet: No progress bars (there are none anyway where standard error is no terminal).

    Raises:
        ValueError: A value of the configuration is out of range, or no run can be read.
    """
    rules, labels, given = config.build(), config.labels.build(), config.quality.scale()
    files = find_runs(Path(config.path), rules.stamps, rules.poses, rules.kind)
    labels.check([each.name for each in files])
    found, failed = read_runs(files, rules, quiet) if len(files) > 1 else ([read_run(files[0], rules, quiet=quiet)], {})
    if not found:
        raise ValueError(
            f"path: none of the {len(files)} runs in {config.path} can be read: {next(iter(failed.values()))}"
        )
    if given_starts := config.quality.starts:
        robots = {robot for run in found for robot in (*run.loops, *run.commands, *run.limits)}
        if robots and not robots & set(given_starts):
            raise ValueError(f"quality.starts: got {', '.join(given_starts)}, expected one of the robots "
                             f"{', '.join(sorted(robots))}")  # fmt: skip
    named = [labels(each.name) for each in found]
    scale = given or scale_of(found)
    summary = run_table(found, named, scale)
    keys = list(dict.fromkeys(key for label in named for key in label))
    groups = group_table(summary, keys) if keys else None
    result = Ingested(
        found, named, scale, summary, robot_table(found, named, scale), groups, findings_table(found), failed
    )
    if folder is not None:
        _write(result, config, folder)
    return result


_LIMITS = "# What each robot was seen to do, in SI units: lower bounds, as what was not driven is not in them.\n"


def _write(result: Ingested, config: IngestConfig, folder: Path) -> None:
    left_out = pd.DataFrame([{"run": name, "left_out": why} for name, why in result.failed.items()])
    summary = pd.concat([result.summary, left_out], ignore_index=True) if result.failed else result.summary
    tables = {"summary": summary, "robots": result.robots, "findings": result.findings, "groups": result.groups}
    for name, table in tables.items():
        if table is not None and len(table):
            write_table(folder / name, table)
    places = file_names([each.name for each in result.runs])
    for each in result.runs:
        place, robots = folder / "runs" / places[each.name], file_names(list(each.loops))
        for name, delays in each.one_way.items():
            write_table(place / f"delays_{name}", pd.DataFrame({"delay": delays}))
        for robot, trace in each.loops.items():
            write_table(place / f"trace_{robots[robot]}", trace.table)
            write_table(place / f"reliability_{robots[robot]}", reliability_table(trace, config.deadline_ms))
        if each.limits:
            seen = plain({robot: limits_values(limits) for robot, limits in each.limits.items()})
            write_text(place / "limits.yaml", _LIMITS + OmegaConf.to_yaml(OmegaConf.create(seen)))
        if config.figures:
            draw_recorded(each, place)
    scale = result.scale
    write_json(folder / "record.json", {
        "j_med": scale and scale.median, "j_max": scale and scale.largest, "failed": result.failed, **provenance(),
    })  # fmt: skip
    write_config(folder, config.model_dump())


def file_name(name: str) -> str:
    """A run's or robot's name as part of a path."""
    return re.sub(r"[^\w.-]+", "__", name).strip("_.") or "run"


def file_names(names: Sequence[str]) -> dict[str, str]:
    """A part of a path for each name, no two of them the same, on disks that tell no capitals apart either."""
    found: dict[str, str] = {}
    for name in names:
        plain, taken = file_name(name), {each.lower() for each in found.values()}
        numbered = (plain if k == 1 else f"{plain}_{k}" for k in count(1))
        found[name] = next(each for each in numbered if each.lower() not in taken)
    return found


def report(result: Ingested) -> str:
    """The runs as a few lines each for a terminal."""
    rows = result.summary.to_dict("records")
    lines = [line for each, row in zip(result.runs, rows, strict=True) for line in run_lines(each, row.get("qoc"))]
    lines += [f"{name}: left out: {why}" for name, why in result.failed.items()]
    if result.groups is not None and len(result.runs) > 1:
        lines += ["", result.groups.to_string(index=False, float_format=lambda v: f"{v:.4g}")]
    if result.scale is not None:
        median, largest = result.scale.median, result.scale.largest
        lines += ["", f"QoC is relative to J_med = {median:.4g} s and J_max = {largest:.4g} s."]
    elif result.summary.get("auc", pd.Series(dtype=float)).notna().any():
        lines += ["", "No QoC: one AUC has nothing to be compared with; quality.j_med and quality.j_max give a scale."]
    return "\n".join(lines)


def main(cfg: DictConfig) -> None:
    """Command line."""
    config = load(IngestConfig, cfg)
    folder = output_dir()
    result = run(config, folder)
    print(report(result))
    print(f"tables, traces and figures are in {folder}")
    if result.failed:
        names = ", ".join(result.failed)
        print(f"error: {len(result.failed)} of {len(result.failed) + len(result.runs)} runs cannot be read ({names}); "
              "the others are judged", file=sys.stderr)  # fmt: skip
        sys.exit(1)
