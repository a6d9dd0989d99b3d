"""Any parameter in a sweep: values that programs take as arrays, values that they are made for, and several at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir

from qocjax import Design, Scenario, evaluate, one_at_a_time, open_study, paper_network
from qocjax.commands.sweep import run
from qocjax.commands.sweep_page import policy_text
from qocjax.config import conf_dir, load
from qocjax.config.study import StudyConfig, build_problem
from qocjax.controllers import Cbf
from qocjax.figures.joint_map import joint_map
from qocjax.figures.study import _stem
from qocjax.navigation import NavigationStack, open_floor
from qocjax.navigation.varied import value_at, varied
from qocjax.report.planes import best_chart, plane_chart
from qocjax.single import simulate
from qocjax.statistics.units import joined
from qocjax.study.chunks import Part, plan
from qocjax.study.grid import full_grid
from qocjax.tunables import APF, CBF, LOOP, NAVIGATION, NETWORK, ROBOT, design_name

LITTLE = ["sweep=base", "sweep.seeds=3", "sweep.evaluation_seeds=4", "sweep.deadline_ms=[100,250]", "report=false",
          "loop.tau=0.1", "scenario.horizon=6", "figures=false", "max_collision_share=null"]  # fmt: skip
VALUES = {
    "controller.mppi.temperature": (0.3, 0.1), "controller.mppi.gamma": (0.015, 0.05),
    "controller.mppi.vx_std": (0.2, 0.1), "controller.mppi.wz_std": (0.4, 0.6), "controller.mppi.vx_min": (-0.35, -0.1),
    "controller.mppi.critics.CostCritic.cost_weight": (3.81, 8.0), "controller.inflation.inflation_radius": (0.55, 0.9),
    "controller.inflation.cost_scaling_factor": (10.0, 4.0), "controller.planner.cost_travel_multiplier": (2.0, 1.0),
    "controller.xy_goal_tolerance": (0.25, 0.3), "controller.max_widening": (0.5, 0.2),
    "controller.backup_speed": (0.15, 0.1), "controller.backup_dist": (0.3, 0.2),
}  # fmt: skip


def config(*options: str) -> StudyConfig:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(StudyConfig, compose("sweep", [*LITTLE, *options]))


def stack(scenario: Scenario) -> NavigationStack:
    found = NavigationStack(open_floor(scenario))
    return replace(found, mppi=replace(found.mppi, batch_size=64, time_steps=30))


def test_designs_hold_more_than_the_models_own_values() -> None:
    design = Design.of({"kappa": [1.0, 3.0], "controller.alpha": [2.0, 4.0]})
    assert design.names[-1] == "controller.alpha" and design.values()["kappa"].tolist() == [1.0, 3.0]
    assert float(design.at([1]).others["controller.alpha"][0]) == 4.0
    assert design.having({"controller.alpha": 1.0}).others == {"controller.alpha": 1.0}
    with pytest.raises(ValueError, match=r"controller.alpha: got .*, expected finite"):
        Design(others={"controller.alpha": np.nan})
    with pytest.raises(ValueError, match="others: got 'kappa', expected a name beside"):
        Design(others={"kappa": 1.0})


def test_a_law_reads_what_it_declares_as_arrays() -> None:
    scenario, network, seeds = Scenario(horizon=4.0), paper_network(), range(3)
    designs = Design(tau=0.05, deadline=0.2, others={"controller.alpha": [0.5, 3.0]})
    together = evaluate(scenario, designs, network, seeds, controller=Cbf(9.0))
    assert together["controller.alpha"].attrs["units"] == "1/s"
    for k, alpha in enumerate((0.5, 3.0)):
        alone = evaluate(scenario, Design(tau=0.05, deadline=0.2), network, seeds, controller=Cbf(alpha))
        np.testing.assert_allclose(together["auc"].values[k], alone["auc"].values[0], rtol=1e-5)
    assert not np.allclose(together["auc"].values[0], together["auc"].values[1], rtol=1e-3)
    with pytest.raises(ValueError, match=r"controller.alpha: got 0.0, expected > 0"):
        evaluate(scenario, designs.having({"controller.alpha": 0.0}), network, seeds, controller=Cbf())
    with pytest.raises(ValueError, match="others: got controller.alpha, expected what the controller declares: none"):
        evaluate(scenario, designs, network, seeds)


@pytest.mark.slow
def test_the_stack_with_arrays_is_the_stack_with_numbers() -> None:
    scenario = Scenario(horizon=2.0)
    own, times = stack(scenario), np.full((20, 2), 0.05)
    numbers = {name: values[1] for name, values in VALUES.items()}
    made_for, one = varied(own, numbers), Design(tau=0.1, deadline=0.1)  # type: ignore[arg-type]
    assert value_at(made_for, "controller.mppi.critics.CostCritic.cost_weight") == 8.0
    told = simulate(scenario, one.having(numbers), times, controller=own)
    made = simulate(scenario, one, times, controller=made_for)
    np.testing.assert_allclose(told.pose, made.pose, atol=2e-3)
    assert Design(tau=0.1, others=VALUES).at([1]).others["controller.backup_speed"].tolist() == [0.1]
    with pytest.raises(ValueError, match="ObstaclesCritic: got a critic that is not used"):
        name = "controller.mppi.critics.ObstaclesCritic.repulsion_weight"
        simulate(scenario, Design(tau=0.1, deadline=0.1, others={name: 1.0}), times, controller=own)


@pytest.mark.slow
def test_the_stack_takes_designs_together_as_one_by_one() -> None:
    scenario, network = Scenario(horizon=3.0), paper_network()
    own, seeds = stack(scenario), range(2)
    both = evaluate(scenario, Design(tau=0.1, deadline=0.2, others=VALUES), network, seeds, controller=own)
    for k in (0, 1):
        made_for = varied(own, {name: values[k] for name, values in VALUES.items()})  # type: ignore[arg-type]
        alone = evaluate(scenario, Design(tau=0.1, deadline=0.2), network, seeds, controller=made_for)
        np.testing.assert_allclose(both["auc"].values[k], alone["auc"].values[0], rtol=1e-3)


def test_options_that_programs_are_made_for_are_set_ups_of_their_own() -> None:
    names = "+sweep.grids.loop.hold_timeout=[0.2,1]", "+sweep.grids.scenario.horizon=[4,6]", "+sweep.grids.kappa=[1,2]"
    problem = config("loop.hold=timeout", *names).build_problem()
    assert problem.apart == ("loop.hold_timeout", "scenario.horizon")
    found = {key: (setup.rules.hold_timeout, setup.scenario.horizon) for key, setup in problem.setups.items()}
    assert found == {key: key for key in ((0.2, 6.0), (1.0, 6.0), (0.5, 4.0), (0.5, 6.0))}
    assert build_problem(problem.configuration or {}).setups.keys() == problem.setups.keys()
    chunks = plan(problem, Part("selection", range(3)), 1.0)
    horizons = np.asarray(problem.designs.others["scenario.horizon"])
    assert all(len({horizons[k] for k in chunk.designs}) == 1 for chunk in chunks)
    assert sum(chunk.steps for chunk in chunks) == 3 * 2 * (2 * 40 + 8 * 60)


@pytest.mark.slow
def test_a_study_of_options_is_its_studies_one_by_one(tmp_path: Path) -> None:
    options = ("loop.hold=timeout", "network.edge.discipline=latest", "robot.radius=0.2")
    study = run(config(*options, "+sweep.grids.network.edge.workers=[1,3]", "+sweep.grids.loop.hold_timeout=[0.2]"),
                tmp_path, quiet=True)  # fmt: skip
    assert set(study.results["sweep"]) == {"network.edge.workers", "loop.hold_timeout"}
    swept = study.results[study.results["sweep"] == "network.edge.workers"]
    auc = {value: rows["auc"].to_numpy() for value, rows in swept.groupby("value")}
    for workers in (1, 3):
        alone = run(config(*options, f"network.edge.workers={workers}", "+sweep.grids.kappa=[2]"), quiet=True)
        np.testing.assert_allclose(auc[workers], alone.results["auc"])
    assert auc[1][0] != auc[3][0]
    opened = open_study(tmp_path)
    pd.testing.assert_frame_equal(opened.results, study.results)
    assert opened.sweep("network.edge.workers")["auc"].dims == ("network.edge.workers", "deadline", "seed", "robot")


def test_several_parameters_make_a_full_grid() -> None:
    study = run(
        config("+sweep.grids.kappa=[1,4]", "+sweep.grids.gamma=[2,1,3]", "sweep.axes=[kappa,gamma]"), quiet=True
    )
    results, policies = study.results, study.policies
    assert list(results["sweep"].unique()) == ["kappa,gamma"] and len(results) == 2 * 3 * 2
    pairs = results[["kappa", "gamma"]].to_numpy()[::2]
    np.testing.assert_array_equal(pairs, [(k, g) for k in (1, 4) for g in (1, 2, 3)])
    best = results.loc[results["qoc"].idxmax()]
    chosen = policies[policies["policy"] == "Co-design"].iloc[0]
    assert tuple(chosen[["kappa", "gamma", "deadline"]]) == tuple(best[["kappa", "gamma", "deadline"]])
    runs = study.sweep("kappa,gamma")
    assert dict(runs.sizes) == {"kappa": 2, "gamma": 3, "deadline": 2, "seed": 3, "robot": 2}
    cell = results[(results["kappa"] == 4) & (results["gamma"] == 3) & (results["deadline"] == 0.25)]
    here = runs["auc"].sel(kappa=4, gamma=3, deadline=0.25)
    np.testing.assert_allclose(here.mean(), cell["auc"].item(), rtol=1e-6)
    assert f"{chosen['kappa']:g}, {chosen['gamma']:g}" in policy_text(policies)


def test_pictures_of_several_parameters_show_the_table() -> None:
    grid = full_grid(Design(tau=0.1), {"kappa": [1.0, 2.0], "gamma": [1.0, 3.0], "eta": [0.0, 1.0]}, [0.1, 0.2])
    assert grid.sweep[0] == "kappa,gamma,eta" and grid.rows("kappa,gamma,eta").shape == (8, 2)
    values = {name: np.asarray(value)[grid.design] for name, value in grid.designs.values().items()}
    qoc = values["kappa"] + 0.1 * values["gamma"] - values["eta"] + 10 * values["deadline"]
    table = pd.DataFrame({"sweep": grid.sweep, "value": grid.value, "qoc": qoc, "qoc_se": 0.1} | values)
    chosen = pd.DataFrame([table.loc[qoc.argmax()].to_dict() | {"policy": "Co-design"}])
    figure = joint_map(table, chosen, "kappa,gamma,eta")
    shown = [panel for panel in figure.axes if panel.get_title()]
    assert [panel.get_title() for panel in shown] == [r"$\Delta$ = 100 ms", r"$\Delta$ = 200 ms"]
    heat = np.asarray(shown[1].collections[0].get_array())
    np.testing.assert_allclose(heat, [[3.1, 3.3], [4.1, 4.3]])  # the best eta in each cell
    chart = plane_chart(table, chosen, "kappa,gamma,eta")
    np.testing.assert_allclose(chart["data"][1]["z"], heat)
    assert [each["visible"] for each in chart["data"]] == [False, True, True]
    assert best_chart(table, "kappa,gamma,eta")["data"][0]["y"].tolist() == pytest.approx([3.3, 4.3])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["+sweep.grids.foo=[1]"], "sweep.grids: got foo, expected one of v_max, "),
        (["+sweep.grids.controller.foo=[1]"], "sweep.grids.controller.foo: got no number, expected an option of"),
        (["+sweep.grids.loop.hold=[1]"], "sweep.grids.loop.hold: got 'hold', expected an option"),
        (["+sweep.grids.loop.hold_timeout=[1]"], "got it with loop.hold=hold, which does not read it"),
        (["+sweep.grids.network.edge.workers=[1]"], "got it with network.edge.discipline=unlimited"),
        (["+sweep.grids.robot.radius=[0]"], "robot.radius: got .*0.0.*, expected > 0"),
        (["+sweep.grids.scenario.horizon=[0.01]"], r"tau: got \[0.1, 0.1\], expected <= 0.01"),
        (["+sweep.grids.kappa=[1]", "+sweep.grids.controller.kappa=[1]"], "expected one grid of a parameter"),
        (["+sweep.grids.kappa=[1]", "sweep.axes=[kappa]"], "sweep.axes: got .*, expected two or more"),
        (["+sweep.grids.kappa=[1]", "sweep.axes=[kappa,eta]"], "sweep.axes: got 'eta', expected one of kappa"),
    ],
)  # fmt: skip
def test_what_cannot_be_swept_is_said_in_a_line(options: list[str], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        run(config(*options), quiet=True)


def test_names_of_the_configuration_are_those_of_a_design() -> None:
    given = config("+sweep.grids.controller.kappa=[1,2]", "+sweep.grids.robot.v_max=[0.5]").build_grid()
    assert dict.fromkeys(given.sweep) == dict.fromkeys(["kappa", "v_max"])
    plain = one_at_a_time(config("+sweep.grids.kappa=[1]").baseline(), {"kappa": [1, 2], "v_max": [0.5]}, [0.1, 0.25])
    np.testing.assert_array_equal(given.designs.kappa, plain.designs.kappa)


def test_seeds_that_share_an_observation_on_any_network_share_it() -> None:
    def partition(labels: Any) -> list[list[int]]:
        return [[i for i, other in enumerate(labels) if other == each] for each in dict.fromkeys(labels)]

    assert partition(joined([np.array([0, 0, 1, 2]), np.array([5, 6, 6, 7])])) == [[0, 1, 2], [3]]
    assert joined([np.array([3, 4])] * 2).tolist() == [3, 4]


def test_the_page_on_parameters_names_what_is_declared() -> None:
    text = (Path(__file__).parents[1] / "docs" / "parameters.md").read_text(encoding="utf-8")
    for each in (*ROBOT, *LOOP, *APF, *CBF, *NETWORK):
        name = design_name(each.name)
        assert f"`{name}`" in text or name == "deadline", each.name
    for each in NAVIGATION:
        if each.array and ".critics." not in each.name:
            assert f"`{each.name.removeprefix('controller.')}`" in text, each.name


def test_files_of_options_with_like_names_do_not_fall_on_one_another() -> None:
    every = ["robot.ax_max", "controller.mppi.ax_max", "kappa", "controller.mppi.temperature"]
    found = [_stem("qoc", [name], every) for name in every]
    assert found == ["qoc_robot.ax_max", "qoc_controller.mppi.ax_max", "qoc_kappa", "qoc_temperature"]
