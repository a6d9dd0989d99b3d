"""Nav2's parameter files: types that ROS takes, a user's file in and out, and the table that both go by."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml
from hydra import compose, initialize_config_dir

from qocjax import Design, Rules
from qocjax.config import conf_dir, load
from qocjax.config.study import StudyConfig
from qocjax.nav2 import Change, advised, fact, facts, merged, nav2_text, read_params, stack_options, to_options
from qocjax.nav2.advised import setting
from qocjax.nav2.command_line import with_nav2
from qocjax.nav2.document import Document
from qocjax.nav2.known import CRITICS, DWB, HANDLER, INFLATION, MPPI, RPP, SHIM, SIMPLE_GOAL
from qocjax.navigation import critics, path_critics
from qocjax.navigation.stack_parts import STACK_MPPI

# As people keep them: comments, quotes, a list over two lines, a flow mapping, integers where Nav2 wants doubles.
FILE = """\
# our robot
/**:
  ros__parameters:
    use_sim_time: false

controller_server:
  ros__parameters:
    controller_frequency: 20.0  # as tested
    controller_plugins: ["Drive", "Dock"]
    goal_checker_plugins: [goal]
    goal:
      plugin: 'nav2_controller::SimpleGoalChecker'
      xy_goal_tolerance: 0.2
    Drive:
      plugin: "nav2_mppi_controller::MPPIController"
      time_steps: 40
      model_dt: 0.05
      vx_max: 1
      wz_max: 1.5
      critics: [
        "GoalCritic", "CostCritic",
        "PathAngleCritic"]
      GoalCritic: {enabled: true, cost_weight: 5.0}  # heavier

    Dock.plugin: "my_robot::DockController"

local_costmap:
  local_costmap:
    ros__parameters:
      footprint: "[[0.3, 0.4], [-0.3, 0.4], [-0.3, -0.4], [0.3, -0.4]]"
      robot_radius: 0.22
      plugins: ["inflation"]
      inflation: {plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: 0.7}

velocity_smoother:
  ros__parameters:
    max_velocity: [0.8,
                   0.0, 2.0]  # x, y, turn
    min_velocity:
      - -0.8
      - 0.0
      - -2.0
    velocity_timeout: 1.0

# the end
"""
DOUBLES = {each.name for each in facts() if each.type.startswith("double")}


def advice(
    tau: float = 0.1, deadline: float = 0.3, v_max: float = 0.7, omega_max: float = 1.4, age: float = 0.62
) -> SimpleNamespace:
    """What of an advice becomes parameters."""
    return SimpleNamespace(
        verdict="recommended",
        recommended=Design(tau=tau, deadline=deadline, v_max=v_max, omega_max=omega_max),
        judged=pd.DataFrame({"age_peak_p99": [0.9, age]}), network={"name": "5g"},
        character={"percentiles_ms": {"p50": 120.0}, "reliability": 0.97, "p99_miss_run": 3}, unread=(),
    )  # fmt: skip


def leaves(tree: dict, prefix: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in tree.items():
        found |= leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def check_types(text: str) -> dict[str, object]:
    found = leaves(yaml.safe_load(text))
    for name, value in found.items():
        if name.rsplit(".", 1)[-1] in DOUBLES:
            assert all(type(item) is float for item in (value if isinstance(value, list) else [value])), name
    return found


@pytest.mark.parametrize(("tau", "v", "omega"), [(1.0, 1.0, 2.0), (0.01, 0.7, 1.4), (0.07, 3.0, 1.0), (2.0, 0.2, 10)])
def test_every_double_has_a_point(tau: float, v: float, omega: float) -> None:
    found = check_types(nav2_text(advice(tau, 4 * tau, v, omega), Rules()))
    server = "controller_server.ros__parameters."
    assert found[f"{server}FollowPath.vx_max"] == v and found[f"{server}FollowPath.wz_max"] == omega
    step, steps = found[f"{server}FollowPath.model_dt"], found[f"{server}FollowPath.time_steps"]
    period = 1.0 / found[f"{server}controller_frequency"]
    assert type(steps) is int and steps * step == pytest.approx(2.8, abs=step / 2)
    assert period <= step + 1e-6 and (step == 0.05 or abs(step - tau) < 1e-6)  # what Nav2 lets pass
    smoother = "velocity_smoother.ros__parameters."
    assert found[f"{smoother}max_velocity"] == [v, 0.0, omega]
    assert found[f"{smoother}min_velocity"] == [-min(v, 0.5), 0.0, -omega]


def test_whole_numbers_drawn_at_random_keep_their_types() -> None:
    rng = np.random.default_rng(0)
    for _ in range(40):
        v, omega = (float(each) for each in rng.choice([1e-5, 0.5, 1, 2, 3, 10, 1e5], 2))
        tau = float(rng.choice([1e-4, 0.01, 0.04, 0.05, 0.3, 1, 2]))
        for source in (None, FILE):
            check_types(nav2_text(advice(tau, tau, v, omega), Rules(), source).replace("vx_max: 1\n", ""))


def test_a_file_is_read() -> None:
    params = read_params_of(FILE)
    assert to_options(params) == {
        "loop.tau": 0.05, "robot.v_max": 0.8, "robot.omega_max": 1.5, "robot.radius": pytest.approx(0.5)}  # fmt: skip
    assert stack_options(params) == {
        "controller.mppi.time_steps": 40, "controller.mppi.model_dt": 0.05, "controller.mppi.prune_distance": 1.5,
        "controller.mppi.critics.ConstraintCritic": None, "controller.mppi.critics.GoalCritic.cost_weight": 5.0,
        "controller.mppi.critics.PathAlignCritic": None, "controller.mppi.critics.PathFollowCritic": None,
        "controller.mppi.critics.PreferForwardCritic": None,
        "controller.inflation.inflation_radius": 0.7, "controller.xy_goal_tolerance": 0.2}  # fmt: skip
    assert params.unknown == (
        "Drive.PathAngleCritic: no such critic in the simulated stack", "Dock: my_robot::DockController")  # fmt: skip
    (remark,) = params.remarks
    assert remark == "file.yaml:18: Drive.vx_max is 1; Nav2 declares it double and refuses this"


SMOOTHER = "velocity_smoother:\n  ros__parameters:\n"


def test_the_smoothers_accelerations_are_the_robots(tmp_path: Path) -> None:
    limits = "    max_accel: [2.5, 0.0, 3.2]\n    max_decel: [-2.0, 0.0, -3.0]\n"
    path = tmp_path / "nav2.yaml"
    path.write_text(text := FILE.replace(SMOOTHER, SMOOTHER + limits), encoding="utf-8")
    found = to_options(read_params_of(text))
    assert tuple(found[f"robot.{name}"] for name in ("ax_max", "ax_min", "az_max")) == (2.5, -2.0, 3.0)
    arguments, _ = with_nav2([f"nav2={path}", "robot=turtlebot4"])  # which does no more than its maker says
    assert {"robot.ax_max=0.9", "robot.ax_min=-0.9", "robot.az_max=3.0", "robot.v_max=0.306"} < set(arguments)
    arguments, notes = with_nav2([f"nav2={path}", "robot=holonomic"])
    assert not [each for each in arguments if each.startswith("robot.a")]
    assert "left alone: robot.ax_max, robot.ax_min, robot.az_max: this robot obeys commands at once" in "\n".join(notes)


@pytest.mark.parametrize(
    ("limits", "message"),
    [("max_accel: [-2.5, 0.0, 3.2]", r"max_accel: got \[-2.5, 0.0, 3.2\], expected none below 0"),
     ("max_decel: [2.5, 0.0, -3.2]", r"max_decel: got \[2.5, 0.0, -3.2\], expected none above 0"),
     ("max_accel: [0.0, 0.0, 0.0]", r"max_accel: got \[0.0, 0.0, 0.0\], expected x and turn above 0"),
     ("max_accel: [2.5, 3.2]", r"max_accel: got 2 numbers, expected 3"),
     ("max_decel: [-2.5, 0.0, 0.0, 0.0, 0.0, -3.2]", r"max_decel: got 6 numbers, expected 3 .* as many for all")],
)  # fmt: skip
def test_limits_that_nav2_refuses_are_refused(limits: str, message: str) -> None:
    with pytest.raises(ValueError, match=rf"file.yaml:\d+: {message}"):
        read_params_of(FILE.replace(SMOOTHER, f"{SMOOTHER}    {limits}\n"))


def test_overrides_of_qos_that_do_nothing_or_harm_are_said() -> None:
    lines = """\
    qos_overrides./cmd_vel_nav.publisher.depth: 1
    qos_overrides./cmd_vel_nav.publisher.reliability: best_effort
    qos_overrides./cmd_vel_nav.publisher.lifespan: 100000000
"""
    remarks = read_params_of(FILE.replace("    controller_frequency", lines + "    controller_frequency", 1)).remarks
    assert len(remarks) == 3 and any("Nav2's readers are RELIABLE" in each for each in remarks)
    assert any("lifespan: Nav2 lets history, depth, reliability and durability" in each for each in remarks)


def test_where_the_stack_is_not_the_files_is_said(tmp_path: Path) -> None:
    def notes(text: str) -> str:
        (tmp_path / "nav2.yaml").write_text(text, encoding="utf-8")
        return "\n".join(with_nav2([f"nav2={tmp_path / 'nav2.yaml'}", "controller=navigation", "robot.v_max=0.2"])[1])

    assert "its controller is DWBLocalPlanner; the simulated stack is MPPI" in notes(FILE.replace(MPPI, DWB))
    i, j = FILE.index("      critics: ["), FILE.index("      GoalCritic: {")
    said = notes(FILE[:i] + FILE[j:])
    assert "Drive names no critic that is simulated; the stack keeps its own" in said and "robot.v_max" not in said
    handler = "    path_handler_plugins: [H]\n    H: {plugin: 'my::Handler'}\n    goal:\n"
    assert "left alone: H: my::Handler" in notes(FILE.replace("    goal:\n", handler, 1))


def test_the_stack_has_the_critics_of_the_file(tmp_path: Path) -> None:
    """Named and switched on, with the file's values, else with Nav2's own where the stack departs from them."""
    named = """\
      vx_std: 0.25
      clamp_raw_controls: true
      critics: ["ConstraintCritic", "ObstaclesCritic", "PathFollowCritic", "PreferForwardCritic", "GoalAngleCritic"]
      PreferForwardCritic: {enabled: false, cost_weight: 1.0}
      ConstraintCritic: {cost_weight: 3.0, cost_power: 2}
"""
    i, j = FILE.index("      critics: ["), FILE.index("      GoalCritic: {")
    path = tmp_path / "nav2.yaml"
    path.write_text(FILE[:i] + named + FILE[j:], encoding="utf-8")
    arguments, notes = with_nav2([f"nav2={path}", "controller=navigation"])
    assert "~controller.mppi.critics.PreferForwardCritic" in notes[0]
    options = [each for each in arguments if not each.startswith("nav2=")]
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        mppi = load(StudyConfig, compose("sweep", options)).controller.mppi.build(1.5)  # type: ignore[union-attr]
    assert (mppi.vx_std, mppi.clamp_raw_controls, mppi.prune_distance) == (0.25, True, 1.5)
    expected = {
        critics.ConstraintCritic(cost_weight=3.0, cost_power=2), path_critics.PathFollowCritic(cost_weight=5.0),
        critics.ObstaclesCritic(inflation_radius=0.7),
    }  # fmt: skip
    assert set(mppi.critics) == expected


def test_a_fragment_has_what_the_simulated_stack_has_otherwise() -> None:
    mppi = replace(STACK_MPPI, batch_size=500, critics=(critics.CostCritic(cost_power=2), critics.GoalCritic()))
    found = leaves(yaml.safe_load(nav2_text(advice(0.05), Rules(), None, mppi)))
    prefix = "controller_server.ros__parameters.FollowPath."
    told = {name.removeprefix(prefix): value for name, value in found.items() if name.startswith(prefix)}
    assert told["critics"] == ["CostCritic", "GoalCritic"] and told["batch_size"] == 500
    assert (told["CostCritic.cost_power"], told["prune_distance"], told["time_steps"]) == (2, 2.5, 56)
    assert "vx_std" not in told and "GoalCritic.cost_weight" not in told and told["vx_max"] == 0.7


def test_the_path_is_cut_where_the_path_handler_says() -> None:
    handler = "    path_handler_plugins: [Handler]\n    Handler: {plugin: 'nav2_controller::FeasiblePathHandler'%s}\n"
    for more, expected in (("", 2.0), (", prune_distance: 3.5", 3.5)):
        text = FILE.replace("    goal:\n", handler % more + "    goal:\n", 1)
        assert stack_options(read_params_of(text))["controller.mppi.prune_distance"] == expected


def test_accelerations_are_read_whatever_their_signs() -> None:
    signs = FILE.replace(
        "      time_steps: 40\n", "      time_steps: 40\n      ax_max: -2.0\n      ax_min: 2.5\n      az_max: 3.2\n"
    )
    options = stack_options(read_params_of(signs))
    assert [options[f"controller.mppi.{name}"] for name in ("ax_max", "ax_min", "az_max")] == [2.0, -2.5, 3.2]


def read_params_of(text: str):
    from qocjax.nav2.read import params_of

    return params_of(Document(text, "file.yaml"))


def test_a_file_comes_back_whole() -> None:
    """All lines stay, in order, but those whose values are advised; and once more changes nothing."""
    text = nav2_text(advice(), Rules(), FILE)
    body = text.split("\n\n", 1)[1].split("\n# ---- notes")[0].split("\n")
    changed = [(a, b) for a, b in zip(FILE.split("\n"), body, strict=False) if a != b]
    assert changed == [
        ("    controller_frequency: 20.0  # as tested",
         "    controller_frequency: 10.0  # as tested; 1 / tau (1/s); was 20.0"),
        ("      time_steps: 40", "      time_steps: 20  # of model_dt, so that the horizon stays 2 s; was 40"),
        ("      model_dt: 0.05", "      model_dt: 0.1  # s; no shorter than the period, which Nav2 refuses; was 0.05"),
        ("      vx_max: 1", "      vx_max: 0.7  # m/s; was 1"),
        ("      wz_max: 1.5", "      wz_max: 1.4  # rad/s; was 1.5"),
        ("    max_velocity: [0.8,", "    max_velocity: [0.7,"),
        ("                   0.0, 2.0]  # x, y, turn",
         "                   0.0, 1.4]  # x, y, turn; m/s, m/s, rad/s; was [0.8, 0.0, 2.0]"),
        ("      - -0.8", "      - -0.7"),
        ("      - -2.0", "      - -1.4  # m/s, m/s, rad/s; was [-0.8, 0.0, -2.0]"),
        ("    velocity_timeout: 1.0",
         "    velocity_timeout: 0.75  # s; 99 % of the simulated runs had no command older than 0.72 s; was 1.0"),
    ]  # fmt: skip
    assert len(FILE.split("\n")) == len(body)
    assert nav2_text(advice(), Rules(), text) == text
    check_types(text)


def test_a_file_on_windows_keeps_its_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "nav2.yaml"
    path.write_bytes(FILE.replace("\n", "\r\n").encode())
    text = nav2_text(advice(), Rules(), path)
    assert "\n" not in text.replace("\r\n", "")
    assert text.replace("\r\n", "\n") == nav2_text(advice(), Rules(), FILE)
    assert read_params(path).frequency == 20.0


def test_no_robot_is_made_faster_than_its_file() -> None:
    text = nav2_text(advice(v_max=5.0, omega_max=9.0), Rules(), FILE)
    found = check_types(text)
    assert found["controller_server.ros__parameters.Drive.vx_max"] == 1.0  # of another type alone
    assert found["velocity_smoother.ros__parameters.max_velocity"] == [0.8, 0.0, 2.0]
    assert "speed stays at 0.8 m/s, where 5 is advised" in text


@pytest.mark.parametrize(
    ("kind", "own", "expected"),
    [
        (DWB, "max_vel_x: 0.4\n      min_vel_x: -0.4", {"max_vel_x": 0.3, "min_vel_x": -0.3, "max_speed_xy": 0.3}),
        (RPP, "desired_linear_vel: 0.5", {"desired_linear_vel": 0.3, "rotate_to_heading_angular_vel": 0.6}),
        (RPP, "max_linear_vel: 0.5\n      max_angular_vel: 1.0", {"max_linear_vel": 0.3, "max_angular_vel": 0.6}),
        (MPPI, "vx_min: -0.2", {"vx_max": 0.3, "vx_min": -0.2, "wz_max": 0.6}),
        (MPPI, "vx_min: -0.4", {"vx_max": 0.3, "vx_min": -0.3, "wz_max": 0.6}),
        (MPPI, "model_delay_vx: 0.0", {"model_delay_vx": 0.25}),
    ],
)
def test_each_controller_by_its_own_names(kind: str, own: str, expected: dict[str, float]) -> None:
    text = f"/r1/controller_server:\n  ros__parameters:\n    FollowPath:\n      plugin: {kind}\n      {own}\n"
    found = check_types(nav2_text(advice(0.1, 0.25, 0.3, 0.6), Rules(), text))
    prefix = "/r1/controller_server.ros__parameters.FollowPath."
    assert expected.items() <= {name.removeprefix(prefix): value for name, value in found.items()}.items()
    assert "/r1/velocity_smoother.ros__parameters.max_velocity" in found


def test_a_shim_hands_on_to_its_controller() -> None:
    for own, prefix in (("primary_controller", ""), ("primary_controller.plugin", "primary_controller.")):
        text = (f"controller_server:\n  ros__parameters:\n    FollowPath.plugin: {SHIM}\n"
                f"    FollowPath.{own}: {DWB}\n    FollowPath.{prefix}max_vel_x: 0.5\n")  # fmt: skip
        found = check_types(nav2_text(advice(v_max=0.3, omega_max=0.6), Rules(), text))
        server = "controller_server.ros__parameters.FollowPath."
        assert found[f"{server}{prefix}max_vel_x"] == 0.3
        assert found[f"{server}rotate_to_heading_angular_vel"] == 0.6


@pytest.mark.parametrize(
    ("rules", "timeout"),
    [(Rules(), 0.75), (Rules(hold="timeout", hold_timeout=0.35), 0.35), (Rules(hold="zero"), 0.4)],
)
def test_the_timeouts_are_those_of_the_hold(rules: Rules, timeout: float) -> None:
    text = FILE + "base:\n  ros__parameters: {cmd_vel_timeout: 0.0, wheel_radius: 0.1}\n"
    found = check_types(nav2_text(advice(), rules, text))
    assert found["velocity_smoother.ros__parameters.velocity_timeout"] == timeout
    assert found["base.ros__parameters.cmd_vel_timeout"] == timeout


@pytest.mark.parametrize(
    ("tau", "deadline", "age", "rules", "timeout"),
    [
        (0.105, 0.075, 0.105, Rules(), 0.3),  # none was missed: in force until 0.18 s of age, and 0.285 s when one is
        (0.105, 0.075, 0.420, Rules(), 0.5),  # until 75 ms after the instant at which it was 0.42 s old
        (0.1, 0.3, 0.6, Rules(), 0.7),  # until the next instant
        (0.1, 0.15, 0.6, Rules("arrival"), 0.7),
    ],
)
def test_a_robot_does_not_brake_while_the_simulated_one_drives(
    tau: float, deadline: float, age: float, rules: Rules, timeout: float
) -> None:
    """A command is in force after the instant at which its age was taken, until the next one takes effect."""
    found = check_types(nav2_text(advice(tau, deadline, age=age), rules, FILE))
    assert found["velocity_smoother.ros__parameters.velocity_timeout"] == timeout


def test_what_nav2_cannot_be_told_is_not_set() -> None:
    """Lifespan and deadline of DDS are for code of one's own; reliability stays."""
    text = nav2_text(advice(), Rules())
    assert "lifespan: 300000000" in text and "model_delay_wz: 0.3" in text
    assert not {"lifespan", "deadline", "reliability", "model_delay_vx"} & {
        part for name in leaves(yaml.safe_load(text)) for part in name.split(".")}  # fmt: skip
    assert "takes nothing from a best_effort writer" in text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("wz_max: 1.5", "wz_max: fast", "file.yaml:19: Drive.wz_max: got 'fast', expected double"),
        ("0.0, 2.0]", "0, 2.0]", "file.yaml:38: max_velocity: got a integer in a list of type double, which ROS"),
        ("wz_max: 1.5", "wz_max:", "file.yaml:19: Drive.wz_max: got no value, which ROS"),
        ("wz_max: 1.5", "wz_max: [", "file.yaml:.*: no YAML: "),
        ("wz_max: 1.5", "wz_max: .nan", "file.yaml:19: Drive.wz_max: got nan, expected a finite number"),
        ("xy_goal_tolerance: 0.2", "a: &x 1\n      b: *x", "file.yaml:14: goal.b: got an alias, which ROS"),
        ("controller_server:", "planner_server:", "file.yaml:1: got no controller_server"),
        ("  ros__parameters:\n    use_sim_time", "  use_sim_time", "file.yaml:3: use_sim_time: got a value above ros"),
    ],
)
def test_bad_files_are_one_line_with_its_number(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message) as error:
        read_params_of(FILE.replace(old, new))
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="none.yaml: no such file"):
        read_params(tmp_path / "none.yaml")


def test_every_name_that_is_written_is_in_the_table_with_its_type() -> None:
    kinds = {"double": float, "integer": int, "double_array": list}
    plugins = {"Drive": MPPI, "A": DWB, "B": RPP, "C": SHIM, "FollowPath": MPPI}
    more = "".join(f"    {name}: {{plugin: '{kind}', primary_controller: '{DWB}'}}\n" for name, kind in plugins.items())
    text = FILE.replace("    goal:\n", more.replace("    Drive", "    Other") + "    goal:\n", 1)
    text = text.replace('["Drive", "Dock"]', '["Drive", "A", "B", "C"]')
    best = setting(advice(0.001), Rules())  # type: ignore[arg-type]  # what it uses of one
    for change in [*advised(best), *advised(best, read_params_of(text))]:
        name, _, own = change.name.rpartition(".")
        known = fact(change.node, own, plugins[name] if name else "") if name != "C" else None
        known = known or next(each for each in facts(change.node) if each.name == own and each.plugin in (DWB, SHIM))
        assert type(change.value) is kinds[known.type], change
    with pytest.raises(KeyError, match="velocity_smoother max_speed"):
        fact("velocity_smoother", "max_speed")
    known = {MPPI, DWB, RPP, SHIM, INFLATION, SIMPLE_GOAL, HANDLER}
    assert {each.plugin for each in facts() if each.plugin} == known
    assert all(hasattr(critics, name) or hasattr(path_critics, name) for name in CRITICS)


def test_a_default_in_the_table_is_of_its_type() -> None:
    kinds = {"double": float, "integer": int, "bool": bool, "string": str}
    for each in facts():
        for default in filter(None, each.defaults):
            value = yaml.safe_load(default) if each.type != "string" else default
            for item in value if isinstance(value, list) else [value]:
                assert type(item) is kinds[each.type.removesuffix("_array")], each
    assert fact("controller_server", "model_delay_vx", MPPI).since == "lyrical"
    assert len({(each.node, each.plugin, each.name) for each in facts()}) == len(facts())


def test_the_document_has_the_whole_table() -> None:
    text = (Path(__file__).parents[1] / "docs" / "nav2.md").read_text(encoding="utf-8")
    for each in facts():
        row = f"| {each.node} | {each.plugin.rsplit('::', 1)[-1]} | `{each.name}` | {each.type} |"
        assert any(line.startswith(row) and line.endswith(f" | {each.meaning} |") for line in text.split("\n")), row


def test_merged_adds_what_is_missing_where_it_belongs() -> None:
    changes = [Change("velocity_smoother", "feedback", "OPEN_LOOP", "w"), Change("collision_monitor", "a.b", 2.0, "w"),
               Change("controller_server", "Dock.speed", 1.0, "w")]  # fmt: skip
    found = leaves(yaml.safe_load(text := merged(FILE, changes)))
    assert found["velocity_smoother.ros__parameters.feedback"] == "OPEN_LOOP"
    assert found["collision_monitor.ros__parameters.a.b"] == 2.0
    assert "    Dock.speed: 1.0  # added; w\n" in text  # by dots, as its neighbour
    assert all(line in text.split("\n") for line in FILE.split("\n"))


def ros_parser() -> Callable[[Path], bool]:
    """ROS's own parser, from PyPI's ros-rcl-yaml-param-parser or QOCJAX_ROS_LIB; skips without."""
    folder = Path(os.environ.get("QOCJAX_ROS_LIB") or Path(sys.prefix) / "lib")
    found = importlib.util.find_spec("rcl_yaml_param_parser") or os.environ.get("QOCJAX_ROS_LIB")
    if not found or not (folder / "librcl_yaml_param_parser.so").exists():
        pytest.skip("no parser of ROS here (pip install ros-rcl-yaml-param-parser, or its lib in QOCJAX_ROS_LIB)")
    names = ("rcutils", "rosidl_runtime_c", "rosidl_dynamic_typesupport", "rmw", "rcl_yaml_param_parser")
    for path in [*folder.rglob("libyaml-*.so*"), *(folder / f"lib{name}.so" for name in names)]:
        parser = ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    allocator = type("Allocator", (ctypes.Structure,), {"_fields_": [(name, ctypes.c_void_p) for name in "abcde"]})
    tools = ctypes.CDLL(str(folder / "librcutils.so"))
    tools.rcutils_get_default_allocator.restype = allocator
    parser.rcl_yaml_node_struct_init.restype = ctypes.c_void_p
    parser.rcl_yaml_node_struct_init.argtypes = [allocator]
    parser.rcl_parse_yaml_file.restype = ctypes.c_bool
    parser.rcl_parse_yaml_file.argtypes = [ctypes.c_char_p, ctypes.c_void_p]

    def accepts(path: Path) -> bool:
        params = parser.rcl_yaml_node_struct_init(tools.rcutils_get_default_allocator())
        done = bool(parser.rcl_parse_yaml_file(str(path).encode(), params))
        tools.rcutils_reset_error()
        return done

    return accepts


def test_the_parser_of_ros_takes_every_file(tmp_path: Path) -> None:
    accepts, path = ros_parser(), tmp_path / "nav2.yaml"
    sources = [None, FILE, FILE.replace("\n", "\r\n"), "controller_server:\n  ros__parameters: {use_sim_time: true}\n"]
    for source in sources:
        for tau, v, omega in ((1.0, 1.0, 2.0), (0.01, 0.7, 1.4), (0.3, 1e-5, 1e5)):
            path.write_text(nav2_text(advice(tau, tau, v, omega), Rules(), source), newline="")
            assert accepts(path)
    path.write_text("a:\n  ros__parameters:\n    b: [1, 0.0]\n")
    assert not accepts(path)


def test_a_file_on_the_command_line_stands_for_options(tmp_path: Path) -> None:
    """What is given by hand comes after it and wins; the stack's own values are taken with the stack alone."""
    path = tmp_path / "nav2_params.yaml"
    path.write_text(
        "controller_server:\n  ros__parameters:\n    controller_frequency: 25.0\n    controller_plugins: [FollowPath]\n"
        "    FollowPath:\n      plugin: nav2_mppi_controller::MPPIController\n      vx_max: 0.4\n      wz_max: 1.5\n"
        "      time_steps: 40\n      critics: [NewCritic]\n",
        encoding="utf-8",
    )
    given = [f"nav2={path}", "robot.v_max=0.3"]
    found, notes = with_nav2(given)
    assert found == ["loop.tau=0.04", "robot.v_max=0.4", "robot.omega_max=1.5", *given]
    assert notes[0] == f"{path} sets loop.tau=0.04, robot.omega_max=1.5"  # the speed is given by hand
    assert any("NewCritic" in note and "left alone" in note for note in notes[1:])
    stack, _ = with_nav2([*given, "controller=navigation"])
    assert "controller.mppi.time_steps=40" in stack
    assert with_nav2(["sweep=kappa"]) == (["sweep=kappa"], []) and with_nav2(["nav2=null"]) == (["nav2=null"], [])
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        config = load(StudyConfig, compose("sweep", found))
    assert (config.loop.tau, config.robot.v_max, config.robot.omega_max) == (0.04, 0.3, 1.5)


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    options = ["nav2=none.yaml", f"hydra.run.dir={tmp_path}"]
    done = subprocess.run([sys.executable, "-m", "qocjax.sweep", *options], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and "none.yaml" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_what_is_not_recommended_says_so_first() -> None:
    for verdict, words in (("unsafe", "collisions break their limit"), ("not shown", "does not show")):
        text = nav2_text(SimpleNamespace(**{**vars(advice()), "verdict": verdict}), Rules())  # type: ignore[arg-type]
        assert "# NOT RECOMMENDED: " in text.split("controller_server")[0] and words in text
    assert "NOT RECOMMENDED" not in nav2_text(advice(), Rules())  # type: ignore[arg-type]


def test_a_file_that_would_not_be_read_is_refused(tmp_path: Path) -> None:
    """Named in a configuration file it would stand for nothing: that is said, and nothing runs."""
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text("# @package _global_\nnav2: my.yaml\n", encoding="utf-8")
    options = [f"--config-dir={tmp_path}", "experiment=mine", f"hydra.run.dir={tmp_path / 'run'}"]
    done = subprocess.run([sys.executable, "-m", "qocjax.sweep", *options], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: nav2: got my.yaml from a configuration file, expected it on the command line\n"


@pytest.mark.parametrize("source", [None, FILE])
def test_caps_that_a_recording_alone_shows_come_with_a_warning(source: str | None) -> None:
    """A robot that was driven gently can do more; a cap that was advised below what was driven is advice."""
    gently = {"v_max": 0.5, "omega_max": 0.382}
    text = nav2_text(advice(v_max=0.3, omega_max=0.382), Rules(), source, None, gently)  # type: ignore[arg-type]
    warned = {line.split(":")[0].strip() for line in text.splitlines() if "CAUTION: no advice" in line}
    assert "wz_max" in warned and "vx_max" not in warned
    assert all("robot.omega_max=..." in line for line in text.splitlines() if "CAUTION: no advice" in line)
    assert check_types(text) == check_types(nav2_text(advice(v_max=0.3, omega_max=0.382), Rules(), source))  # type: ignore[arg-type]
    assert "CAUTION" not in nav2_text(advice(v_max=0.3, omega_max=0.3), Rules(), source, None, gently)  # type: ignore[arg-type]
    assert "CAUTION" not in nav2_text(advice(v_max=0.3, omega_max=0.382), Rules(), source)  # type: ignore[arg-type]
