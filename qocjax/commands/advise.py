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
from qocjax.commands.command_line import given_options, output_dir
from qocjax.commands.robot_seen import RobotSeen, limits_values, robot_seen
from qocjax.config.advise import AdviseConfig
from qocjax.config.part import load
from qocjax.figures.advice import advice_figure
from qocjax.figures.margins import delay_reliability_map
from qocjax.figures.save import save
from qocjax.figures.sensitivity import sensitivity_bars
from qocjax.nav2 import nav2_text
from qocjax.recorded.text import run_lines
from qocjax.store import write_config, write_table, write_text
from qocjax.store.provenance import provenance

__all__ = ["advice_values", "main", "page", "run"]

_OFTEN = 30.0  # s between lines of progress
_SLACK = [item.name for item in fields(Slack) if item.name != "plane"]  # its table goes into a file of its own


def run(config: AdviseConfig, folder: Path | None = None, seen: RobotSeen | None = None) -> Advice:
    """Works out the advice of a configuration.

    Args:
        config: What to simulate.
        folder: Where files go; None writes nothing.
        seen: What a bag shows of the robot, for the record.

    Raises:
        ValueError: A value of the configuration is out of range, or nothing can be advised.
    """
    options, network, controller = config.advise, config.build_network(), config.build_controller()
    _checks.bounded("advise.tau_ms", options.tau_ms, above=0)
    taus = [ms / 1e3 for ms in options.tau_ms]
    config.check_rate(network, min([config.loop.tau, *taus]))
    advice = advise(
        config.build_scenario(), network, config.current(), config.bounds(),
        rules=config.loop.build(), key=config.key, longest_deadline=options.longest_deadline_ms / 1e3,
        max_collision_share=options.max_collision_share, how=options.objective, taus=taus,
        effort=config.effort(), asked=config.asked(), scale=config.scale(), controller=controller,
        told=_progress() if controller.costly else None,
    )  # fmt: skip
    if folder is not None:
        values = advice_values(advice) | {"robot": _robot_values(config, seen)} | provenance(controller)
        write_text(folder / "advice.yaml", OmegaConf.to_yaml(OmegaConf.create(values)))
        write_text(
            folder / "nav2_params.yaml",
            nav2_text(
                advice, config.loop.build(), config.nav2 and Path(config.nav2), getattr(controller, "mppi", None)
            ),
        )
        write_config(folder, config.model_dump())
        write_table(folder / "curve", advice.curve)
        if advice.slack is not None:
            write_table(folder / "plane", advice.slack.plane)
        write_table(folder / "elasticities", advice.elasticities)
        if advice.sobol is not None:
            write_table(folder / "sobol", advice.sobol)
        if config.figures:
            _draw(advice, folder / "figures")
    return advice


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
    return {"kind": advice.target.kind, "value": advice.target.value, "text": advice.target.text} | {
        name: {"reached": margin.reached, "best": margin.best_text} for name, margin in margins.items()
    }


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


def _robot_choice() -> tuple[str, bool]:
    """Name of the robot's preset, and whether somebody chose it or any of its values."""
    preset = HydraConfig.get().runtime.choices["robot"]
    given = any(each == "robot" or each.startswith(("robot.", "experiment")) for each in given_options())
    return preset, given


def main(cfg: DictConfig) -> None:
    """Command line."""
    config, seen = load(AdviseConfig, cfg), RobotSeen()
    folder = output_dir()
    if (log := config.log()) is not None:
        recorded = log.read()
        print("\n".join(run_lines(recorded, None)), end="\n\n")
        seen = robot_seen(recorded, config.robot, *_robot_choice())
        for name, value in seen.options.items():
            OmegaConf.update(cfg, f"robot.{name}", value)
        config = load(AdviseConfig, cfg)
    if seen.text:
        print(textwrap.fill(f"ROBOT  {seen.text}", 118, subsequent_indent="  "), end="\n\n", flush=True)
    print(page(run(config, folder, seen)))
    print(f"advice.yaml, nav2_params.yaml and figures are in {folder}")
