"""`python -m qocjax.advise`: from a network or a trace to one page of advice, a figure and ROS 2 parameters."""

from __future__ import annotations

import sys
import textwrap
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from qocjax import _checks
from qocjax.advice.advice import Advice, advise, plain
from qocjax.advice.slack import Slack
from qocjax.commands.advice_page import page
from qocjax.commands.assumed import assumed_text, given_of
from qocjax.commands.command_line import given_options, output_dir
from qocjax.commands.resuming import going_on, resumed
from qocjax.commands.robot_seen import RobotSeen, limits_values, robot_seen
from qocjax.config.advise import AdviseConfig
from qocjax.config.part import load
from qocjax.config.robot import RobotConfig
from qocjax.controllers import Controller
from qocjax.figures.advice import advice_figure
from qocjax.figures.margins import delay_reliability_map
from qocjax.figures.save import save
from qocjax.figures.sensitivity import sensitivity_bars
from qocjax.nav2 import nav2_text
from qocjax.recorded import RecordedRun
from qocjax.recorded.text import run_lines
from qocjax.store import write_table, write_text
from qocjax.store.provenance import provenance
from qocjax.study.problem import data_of

__all__ = ["advice_values", "main", "page", "run"]

_OFTEN = 30.0  # s between lines of progress
_SLACK = [item.name for item in fields(Slack) if item.name != "plane"]  # its table goes into a file of its own


def run(config: AdviseConfig, folder: Path | None = None, seen: RobotSeen | None = None) -> Advice:
    """Works out the advice of a configuration.

    Args:
        config: What to simulate.
        folder: Where pieces and files go; None writes nothing.
        seen: What a bag shows of the robot, for the record.

    Raises:
        ValueError: A value of the configuration is out of range, nothing can be advised, or the folder holds other
            advice.
        OSError: The folder cannot be written, or the disk is full.
    """
    options, network, controller = config.advise, config.build_network(), config.build_controller()
    _checks.bounded("advise.tau_ms", options.tau_ms, above=0)
    taus = [ms / 1e3 for ms in options.tau_ms]
    config.check_rate(network, min([config.loop.tau, *taus]))
    scenario = config.build_scenario()
    with going_on(config, folder, data_of(scenario, network, controller)):
        advice = advise(
            scenario, network, config.current(), config.bounds(),
            rules=config.loop.build(), key=config.key, longest_deadline=options.longest_deadline_ms / 1e3,
            max_collision_share=options.max_collision_share, how=options.objective, taus=taus,
            effort=config.effort(), asked=config.asked(), scale=config.scale(), controller=controller,
            told=_progress() if controller.costly else None,
        )  # fmt: skip
        if folder is not None:
            _write(advice, config, controller, seen, folder)
            if config.figures:
                _draw(advice, folder / "figures")
    return advice


def _write(advice: Advice, config: AdviseConfig, controller: Controller, seen: RobotSeen | None, folder: Path) -> None:
    values = advice_values(advice) | {"robot": _robot_values(config, seen)} | provenance(controller)
    write_text(folder / "advice.yaml", OmegaConf.to_yaml(OmegaConf.create(values)))
    mine, mppi = config.nav2 and Path(config.nav2), getattr(controller, "mppi", None)
    write_text(
        folder / "nav2_params.yaml", nav2_text(advice, config.loop.build(), mine, mppi, seen.options if seen else None)
    )
    tables = {"curve": advice.curve, "elasticities": advice.elasticities, "sobol": advice.sobol}
    tables["plane"] = None if advice.slack is None else advice.slack.plane
    for name, table in tables.items():
        if table is not None:
            write_table(folder / name, table)


def advice_values(advice: Advice) -> dict:
    """The advice as plain values, in SI units unless a name says otherwise; None where there is nothing to say."""
    found = {
        "verdict": advice.verdict, "recommended": advice.recommended, "objective": advice.objective,
        "by_mean": advice.by_mean, "kept_as_they_were": list(advice.kept), "acceptable": advice.acceptable,
        "at_edge": advice.at_edge, "current": advice.current,
        "current_policy": advice.policy,
        "max_collision_share": advice.max_collision_share,
        "network": advice.network, "trace": advice.trace, "computations_at_once": advice.capacity,
        "loop": advice.character, "setup": advice.setup, "judged": advice.judged, "actuation": advice.actuation,
        "assumptions": advice.assumptions, "stress": advice.stress, "target": target_values(advice),
        "margin": advice.margin, "current_margin": advice.current_margin, "ties": advice.ties,
        "slack": advice.slack and {name: getattr(advice.slack, name) for name in _SLACK},
        "growth": advice.growth, "elasticities": advice.elasticities, "sobol": advice.sobol,
        "j_med": advice.scale.median, "j_med_se": advice.scale.median_se, "j_max": advice.scale.largest,
        "seeds": advice.seeds, "simulations": advice.simulations,
    }  # fmt: skip
    for name in ("recommended", "by_mean", "current"):
        found[name] = {key: value for key, value in found[name].values().items() if key not in advice.unread}
    return plain(found)


def _progress() -> Callable[[int], None]:
    """Says on standard error how far a long advice has come, every half minute."""
    begin, done, said = time.monotonic(), 0, 0.0

    def told(runs: int) -> None:
        nonlocal done, said
        done += runs
        passed = time.monotonic() - begin
        if passed - said >= _OFTEN:
            said = passed
            print(f"{done} runs in {passed:.0f} s", file=sys.stderr, flush=True)

    return told


def _robot_values(config: AdviseConfig, seen: RobotSeen | None) -> dict:
    """The robot that is advised on, and what a bag shows of it."""
    found = {"said": seen.text, "seen": limits_values(seen.limits)} if seen is not None and seen.limits else {}
    return plain(config.robot.model_dump() | found)


def target_values(advice: Advice) -> dict:
    """What was asked to be kept, and how near to it recommended and current gains come at their best deadlines."""
    margins = {"recommended": advice.margin, "current": advice.current_margin}
    return {
        "kind": advice.target.kind,
        "value": advice.target.value,
        "text": advice.target.text,
        "little": advice.target.little,
    } | {name: {"reached": margin.reached, "best": margin.best_text} for name, margin in margins.items()}


def _draw(advice: Advice, folder: Path) -> None:
    deadlines = (float(np.asarray(advice.recommended.deadline)), float(np.asarray(advice.current.deadline)))
    save(
        advice_figure(
            advice.curve,
            advice.judged,
            advice.stress,
            advice.margin.ends if advice.margin.reached else None,
            deadlines,
            limit=advice.max_collision_share,
        ),
        folder / "advice",
    )
    if advice.slack is not None:
        points = {name: (at, share) for name, at, share in advice.policies}
        own = pd.DataFrame([*points.values()], columns=["deadline", "reliability"])
        curve = pd.concat([advice.curve[["deadline", "reliability"]], own])
        save(
            delay_reliability_map(advice.slack.plane, curve, points, limit=advice.max_collision_share),
            folder / "margins",
        )
    save(sensitivity_bars(advice.elasticities, advice.sobol), folder / "sensitivity")


def _seen(recorded: RecordedRun, robot: RobotConfig, resumed: bool) -> RobotSeen:
    """The robot that a recording shows, unless somebody chose it or any of its values; a resumed one has it already."""
    preset = HydraConfig.get().runtime.choices["robot"]
    given = any(each == "robot" or each.startswith(("robot.", "experiment")) for each in given_options())
    seen = robot_seen(recorded, robot, preset, given)
    if resumed and any(getattr(robot, name) != value for name, value in seen.options.items()):
        return robot_seen(recorded, robot, preset, True)
    return seen


def main(cfg: DictConfig) -> None:
    """Command line."""
    folder = output_dir()
    asked, seen = load(AdviseConfig, cfg), RobotSeen()
    config = resumed(asked, folder)
    given, choices = given_of(config, asked, given_options()), HydraConfig.get().runtime.choices
    if (log := config.log()) is not None:
        recorded = log.read()
        print("\n".join(run_lines(recorded, None)), end="\n\n")
        seen = _seen(recorded, config.robot, config is not asked)
        if config is asked:
            for name, value in seen.options.items():
                OmegaConf.update(cfg, f"robot.{name}", value)
            config = load(AdviseConfig, cfg)
    if text := assumed_text(seen.text, config, given, (choices["robot"], choices["scenario"])):
        print(textwrap.fill(f"ROBOT  {text}", 118, subsequent_indent="  "), end="\n\n", flush=True)
    print(page(run(config, folder, seen), given))
    print(f"advice.yaml, nav2_params.yaml and figures are in {folder}")
