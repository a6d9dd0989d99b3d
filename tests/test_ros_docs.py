"""What docs/ros.md and the Nav2 fragment say about the nodes is true of them; no ROS needed but for its parser."""

from __future__ import annotations

import re
import shlex
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_nav2 import advice, ros_parser

from qocjax.nav2 import nav2_text
from qocjax.network.schedule import Rules
from qocjax.ros import Counts, DeadlineGate, drawn_loop_times
from qocjax.ros.parameters import DEADLINE, STAMPS, Parameter

TEXT = (Path(__file__).parents[1] / "docs" / "ros.md").read_text(encoding="utf-8")
TABLES = {"deadline": DEADLINE, "stamps": STAMPS}


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


def row(each: Parameter) -> str:
    default = str(each.default).lower() if isinstance(each.default, bool) else each.default
    return f"| `{each.name}` | {each.type} | {default} | {each.range} | {each.meaning} |"


def node_commands(text: str) -> Iterator[tuple[str, dict[str, str], dict[str, str]]]:
    """Node, parameters and remapped names of each command."""
    for node, rest in re.findall(r"-m qocjax\.ros\.(\w+) --ros-args([^\"`\n]*)", text):
        given: dict[str, dict[str, str]] = {"-p": {}, "-r": {}}
        words = shlex.split(re.sub(r"\$\(.*?\)", "robot0", rest))
        for flag, value in zip(words[::2], words[1::2], strict=True):
            if flag in given:
                name, value = value.split(":=")
                given[flag][name] = value
        yield node, given["-p"], given["-r"]


def check(node: str, name: str, value: object) -> None:
    """A value of a parameter that the node takes, of its type and in its range."""
    (each,) = [each for each in TABLES[node] if each.name == name]
    assert type(value) is type(each.default), name
    assert not each.choices or value in each.choices
    assert each.type != "double" or each.least <= value <= each.most  # type: ignore[operator]


def test_the_tables_are_those_of_the_nodes() -> None:
    lines = TEXT.splitlines()
    for table in TABLES.values():
        at = lines.index(row(table[0]))
        assert lines[at : at + len(table) + 1] == [*map(row, table), ""]
    for each in fields(Counts):
        assert f"| `{each.name}` |" in TEXT


def test_commands_and_files_name_parameters_and_topics_that_there_are() -> None:
    topics = {"deadline": {"cmd_vel_in", "cmd_vel_out"}, "stamps": {"pose", "cmd_vel_in", "cmd_vel_out"}}
    found = list(node_commands(TEXT))
    assert {node for node, _, _ in found} == set(TABLES) and len(found) == 3
    for node, given, remapped in found:
        for name, value in given.items():
            check(node, name, yaml.safe_load(value))
        assert set(remapped) - {"__ns"} == topics[node]
    (file,) = map(yaml.safe_load, blocks("yaml"))
    for pattern, part in file.items():
        for name, value in part["ros__parameters"].items():
            if not name.startswith("qos_overrides."):
                check(pattern.rpartition("/")[2], name, value)


def test_the_launch_file_leads_commands_through_the_node() -> None:
    (text,) = blocks("xml")
    launch = ElementTree.fromstring(text)
    (executable,) = launch.iter("executable")
    ((_, _, remapped),) = node_commands(executable.attrib["cmd"])
    smoother = next(each for each in launch.iter("node") if each.attrib["name"] == "velocity_smoother")
    assert [each.attrib for each in smoother.iter("remap")] == [{"from": "cmd_vel", "to": remapped["cmd_vel_out"]}]
    managed = next(each.attrib["value"] for each in launch.iter("param") if each.attrib.get("name") == "node_names")
    assert yaml.safe_load(managed) == [each.attrib["name"] for each in launch.iter("node")][:-1]


def test_the_parser_of_ros_takes_the_file(tmp_path: Path) -> None:
    accepts, path = ros_parser(), tmp_path / "deadline.yaml"
    path.write_text(blocks("yaml")[0])
    assert accepts(path)


@pytest.mark.parametrize(
    "rules",
    [Rules(), Rules(hold="zero"), Rules("arrival", "timeout", hold_timeout=1.0), Rules("instant", "decay")],
    ids=str,
)
def test_the_fragment_of_an_advice_has_the_node_s_command(rules: Rules) -> None:
    ((node, given, remapped),) = node_commands(nav2_text(advice(0.05, 0.3), rules))  # type: ignore[arg-type]
    assert node == "deadline" and remapped == {"cmd_vel_in": "cmd_vel_nav", "cmd_vel_out": "cmd_vel_held"}
    values = {name: yaml.safe_load(value) for name, value in given.items()}
    for name, value in values.items():
        check(node, name, value)
    kept = {name: values[name] for name in ("actuation", "hold", "hold_timeout", "hold_decay") if name in values}
    made = Rules(**kept)
    DeadlineGate(made, values["deadline"], values["period"])
    assert (values["deadline"], values["period"], made.hold) == (0.3, 0.05, rules.hold)
    assert made.actuation == ("arrival" if rules.actuation == "arrival" else "deadline")
    if rules.hold in ("timeout", "decay"):
        assert getattr(made, f"hold_{rules.hold}") == getattr(rules, f"hold_{rules.hold}")


def test_the_network_of_the_example_is_a_delay_of_400_ms() -> None:
    (options,) = re.findall(r"`network='(network=loop\s+.*?)'`", TEXT, re.DOTALL)
    np.testing.assert_allclose(drawn_loop_times(options, 0.05, 0.5, length=20), 0.4, rtol=1e-6)
