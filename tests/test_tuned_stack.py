"""Searches over what a law declares: bounds by name, refusals in a line, and what goes into Nav2's file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hydra import compose, initialize_config_dir

from qocjax import Design
from qocjax.commands.advise import run as advise
from qocjax.commands.codesign import run as codesign
from qocjax.commands.tune import run as tune
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig
from qocjax.config.codesign import CodesignConfig
from qocjax.config.tune import TuneConfig
from qocjax.nav2 import Change, advised, merged, read_params
from qocjax.nav2.advised import Set

LITTLE = ["loop.tau=0.1", "scenario.horizon=6", "figures=false"]
SEARCH = [
    "search.budget=100", "search.block=2", "search.choice_seeds=2", "search.finalists=4", "search.methods=[cma_es]",
    "search.tau=[0.1]", "search.repetitions=1", "search.deadline_ms=[100,300]", "front=null", "sweep=base",
    "+sweep.grids.tau=[0.1]", "sweep.deadline_ms=[100,200]", "sweep.seeds=2", "sweep.evaluation_seeds=4",
]  # fmt: skip
TUNE = ["tune.deadline_ms=[200]", "tune.starts=1", "tune.steps=2", "tune.step_seeds=2", "tune.seeds=2",
        "tune.evaluation_seeds=4", "tune.patience=0"]  # fmt: skip
STACK = ["controller=navigation", "controller.mppi.batch_size=64", "controller.mppi.time_steps=30"]
BEST = Set(0.05, 0.2, 0.7, 1.4, 0.5, "why", 0.2)
TUNED = {"controller.mppi.temperature": 0.12342, "controller.mppi.critics.CostCritic.cost_weight": 6.0,
         "controller.inflation.cost_scaling_factor": 4.0, "controller.xy_goal_tolerance": 0.2,
         "controller.max_widening": 0.3}  # fmt: skip


def config(model: Any, name: str, *options: str) -> Any:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(model, compose(name, [*LITTLE, *options]))


@pytest.mark.slow
def test_a_search_moves_what_the_law_declares() -> None:
    found = codesign(config(CodesignConfig, "codesign", "controller=cbf", *SEARCH), quiet=True)
    assert found.names == ("v_max", "kappa", "gamma", "c_miss", "controller.alpha", "tau")
    chosen = found.contest.chosen
    assert 0.2 <= chosen["controller.alpha"] <= 8.0 and chosen["controller.alpha"] != 2.0
    assert found.contest.policies["controller.alpha"].eq(2.0).all()  # the sweeps leave it where it is configured


def test_slopes_follow_what_the_law_declares() -> None:
    found = tune(config(TuneConfig, "tune", "controller=cbf", "tune.wrt=[controller.alpha]", *TUNE), quiet=True)
    moved = found.trace["controller.alpha"].to_numpy()
    assert found.problem.bounds.names == ("controller.alpha",) and len(set(moved)) > 1
    assert ((moved >= 0.5) & (moved <= 8.0)).all()


@pytest.mark.slow
def test_the_stack_is_searched_and_tuned() -> None:
    found = codesign(config(CodesignConfig, "codesign", *STACK, *SEARCH), quiet=True)
    assert len(found.names) == 10
    assert 0.3 <= found.contest.chosen["controller.inflation.inflation_radius"] <= 1.0
    tuned = tune(config(TuneConfig, "tune", *STACK, *TUNE), quiet=True)
    assert len(tuned.problem.bounds.names) == 3 and np.isfinite(tuned.trace["qoc"]).all()


@pytest.mark.parametrize(
    ("model", "name", "options", "message"),
    [
        (CodesignConfig, "codesign", ["+search.bounds.controller.alpha=[1,2]"],
         "search.bounds: got controller.alpha, expected one of v_max"),
        (CodesignConfig, "codesign", ["controller=cbf", "search.bounds.controller.alpha=[0,2]"],
         "controller.alpha: got .*0.*, expected > 0"),
        (CodesignConfig, "codesign", ["controller=cbf", "search.bounds.eta=[0.1,2]"],
         "search.bounds.eta: got .*, expected null: controller=cbf does not read it"),
        (CodesignConfig, "codesign", ["controller=navigation", "+search.bounds.controller.mppi.batch_size=[10,20]"],
         "search.bounds: got controller.mppi.batch_size, expected one of"),
        (CodesignConfig, "codesign", ["controller=navigation", "search.methods=[sobol_gradient]"],
         "search.methods: got 'sobol_gradient', expected some of random, sobol, cma_es, as controller=navigation"),
        (CodesignConfig, "codesign", ["controller=navigation", "+sweep.grids.controller.mppi.gamma=[0.1]"],
         "sweep.grids: got controller.mppi.gamma, expected bounds of it in search.bounds too"),
        (CodesignConfig, "codesign", ["loop.hold=timeout", "+sweep.grids.loop.hold_timeout=[1]"],
         "sweep.grids: got loop.hold_timeout, expected parameters that a program takes as arrays"),
        (TuneConfig, "tune", ["tune.wrt=[controller.alpha]"], "tune.wrt: got controller.alpha, expected one of v_max"),
        (TuneConfig, "tune", ["controller=navigation", "tune.wrt=[controller.mppi.gamma]"],
         r"tune.bounds.controller.mppi.critics.CostCritic.cost_weight: got .* is not tuned"),
        (TuneConfig, "tune", ["controller=navigation", "tune.wrt=[controller.mppi.gamma]", "~tune.bounds.controller"],
         "tune.wrt: got controller.mppi.gamma without bounds"),
        (TuneConfig, "tune", ["controller=navigation", "tune.wrt=[kappa]"],
         "tune.wrt: got kappa, which navigation does not read, expected what it reads"),
        (TuneConfig, "tune", ["controller=navigation", "tune.estimator=pathwise"],
         "tune.estimator: got pathwise, but navigation does not say that it is smooth"),
    ],
)  # fmt: skip
def test_what_cannot_be_searched_is_said_in_a_line(model: Any, name: str, options: list[str], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message) as caught:
        (codesign if model is CodesignConfig else tune)(config(model, name, *options), quiet=True)
    assert "\n" not in str(caught.value)


def test_advice_takes_bounds_of_the_stack() -> None:
    options = ["controller=navigation", "+advise.bounds.controller.inflation.cost_scaling_factor=[2,20]"]
    given = config(AdviseConfig, "advise", *options)
    assert given.bounds()["controller.inflation.cost_scaling_factor"] == (2, 20)
    assert given.current().others["controller.inflation.cost_scaling_factor"] == 10.0
    assert set(given.current().others) == set(given.bounds()) - {"v_max"}
    assert isinstance(given.current(), Design)


@pytest.mark.slow
def test_advice_moves_what_the_law_declares() -> None:
    little = ["controller=cbf", "+advise.bounds.controller.alpha=[0.5,8]", "advise.points=8", "advise.rounds=[4,8]",
              "advise.fresh_seeds=16", "advise.finalists=4", "advise.margins.delays=0", "advise.margins.points=0",
              "advise.max_collision_share=0.5"]  # fmt: skip
    found = advise(config(AdviseConfig, "advise", *little))
    assert found.elasticities["parameter"].eq("controller.alpha").any()
    assert 0.5 <= float(found.recommended.others["controller.alpha"]) <= 8.0


def values_of(changes: list[Change]) -> dict[str, Any]:
    return {f"{each.node}:{each.name}": each.value for each in changes}


def test_what_is_advised_of_the_stack_goes_into_nav2s_parameters(tmp_path: Path) -> None:
    found = values_of(advised(BEST, tuned=TUNED))
    wanted = {
        "controller_server:FollowPath.temperature": 0.1234, "controller_server:FollowPath.CostCritic.cost_weight": 6.0,
        "local_costmap/local_costmap:inflation_layer.cost_scaling_factor": 4.0,
        "global_costmap/global_costmap:inflation_layer.cost_scaling_factor": 4.0,
        "controller_server:general_goal_checker.xy_goal_tolerance": 0.2,
    }  # fmt: skip
    assert {name: found.get(name) for name in wanted} == wanted
    assert not any("widening" in name for name in found)
    own = tmp_path / "nav2_params.yaml"
    own.write_text("""
controller_server:
  ros__parameters:
    controller_plugins: [Follow]
    Follow:
      plugin: nav2_mppi_controller::MPPIController
      temperature: 0.3
local_costmap:
  local_costmap:
    ros__parameters:
      plugins: [puffer]
      puffer: {plugin: "nav2_costmap_2d::InflationLayer", cost_scaling_factor: 3.0}
""")
    changes = advised(BEST, read_params(own), tuned=TUNED)
    text = merged(own.read_text(), changes)
    tree = yaml.safe_load(text)
    assert tree["controller_server"]["ros__parameters"]["Follow"]["temperature"] == 0.1234
    assert tree["local_costmap"]["local_costmap"]["ros__parameters"]["puffer"]["cost_scaling_factor"] == 4.0
    assert re.search(r"CostCritic.cost_weight|CostCritic:", text)
