"""What `--help` offers is what the command takes, and each of its options has its line."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from qocjax._conf import add_resolver
from qocjax.commands.help import choices_text, described, options_of, options_text, read_remarks, remarks_of
from qocjax.config import conf_dir, load

COMMANDS = sorted(path.stem for path in conf_dir().glob("*.yaml"))
# A command for each group, and what the group needs to be read.
PLACES = {
    "calibrate": ("validate", "calibrate"), "controller": ("sweep", "controller"), "engine": ("sweep", "engine"),
    "delay": ("sweep", "delay@network.compute"), "loss": ("sweep", "loss@network.uplink.loss"),
    "measured": ("validate", "measured"), "network": ("sweep", "network"), "optimiser": ("tune", "optimiser"),
    "profile": ("qos", "profile@network.uplink.profile"), "robot": ("sweep", "robot"),
    "scenario": ("show", "scenario"), "stamps": ("ingest", "stamps"), "sweep": ("sweep", "sweep"),
}  # fmt: skip
CHOICES = [f"{group}/{path.stem}" for group in PLACES for path in sorted((conf_dir() / group).glob("*.yaml"))]
UNIT = re.compile(r"(s|m|ms|rad|1/s|1/m|m/s|rad/s)?")


@pytest.fixture(autouse=True)
def _composer() -> Iterator[None]:
    add_resolver("own_folder", lambda *given: None)
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


def composed(command: str, *options: str) -> DictConfig:
    return compose(command, list(options), return_hydra_config=True)


def without_a_word(cfg: DictConfig) -> list[str]:
    remarks = remarks_of(cfg)
    return [".".join(path) for path, _ in options_of(cfg, remarks) if UNIT.fullmatch(described(path, remarks))]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_has_its_line(command: str) -> None:
    cfg = composed(command)
    assert without_a_word(cfg) == []
    told = [line.split("=")[0] for line in options_text(cfg).splitlines() if re.match(r"[\w.]+=", line)]
    held = [".".join(path) for path in leaves(OmegaConf.to_container(cfg, resolve=False))]
    assert told and all(any(f"{name}.".startswith(f"{each}.") for each in told) for name in held)


def leaves(content: Any, at: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    if isinstance(content, dict):
        for key, value in content.items():
            if (*at, key) != ("hydra",):
                yield from leaves(value, (*at, str(key)))
    elif at:
        yield at


@pytest.mark.parametrize("choice", CHOICES)
def test_every_option_of_a_choice_has_its_line(choice: str) -> None:
    group, name = choice.split("/")
    command, place = PLACES[group]
    assert without_a_word(composed(command, f"{place}={name}")) == []


def accepts(command: str, *options: str) -> bool:
    """Whether a command takes a choice: what its `run` checks before it simulates."""
    schema = importlib.import_module(f"qocjax.{command}").main.model()
    try:
        config = load(schema, compose(command, list(options)))
        checks = {"fleet": ("check",), "qos": ("surrogate_only", "build_topics"), "tune": ("build_controller",)}
        for check in checks.get(command, ()):
            getattr(config, check)()
    except ValueError as error:
        assert str(error).startswith(("network: ", "controller: "))
        return False
    return True


@pytest.mark.parametrize("command", ["fleet", "qos", "sweep", "tune"])
def test_what_is_offered_is_accepted_and_nothing_else(command: str, tmp_path: Path) -> None:
    (tmp_path / "loop.csv").write_text("rtt\n120\n130\n")
    lines = choices_text(composed(command)).replace("\n    ", " ").splitlines()
    offered = {group: names.split(", ") for group, names in (line.split(": ") for line in lines if ": " in line)}
    for group in ("controller", "network"):
        for path in (conf_dir() / group).glob("*.yaml"):
            needed = (
                [f"network.path={tmp_path / 'loop.csv'}", "network.column=rtt", "network.unit=ms", "network.period=0.1"]
                if path.stem == "trace"
                else []
            )
            if path.stem == "custom":
                needed = ["controller._target_=qocjax.controllers.Apf"]
            # A group with one choice is not told.
            assert accepts(command, f"{group}={path.stem}", *needed) == (
                path.stem in offered.get(group, [{"controller": "apf", "network": "dds"}[group]])
            )
    for path in (conf_dir() / "experiment").glob("*.yaml"):
        if path.stem in offered.get("experiment", []) and (command != "sweep" or path.stem in ("ci", "auc_eta")):
            assert accepts(command, f"experiment={path.stem}")


def test_comments_are_read_where_they_stand(tmp_path: Path) -> None:
    file = tmp_path / "some.yaml"
    file.write_text(
        "# Of the file.\nkey: '#1'   # behind\n# Above,\n# two lines.\nplain: [1,\n  2]\npart:   # of all\n"
        "  bare: 1\n  unit: 2   # s\n  long: x  # begins,\n           # goes on\n  inline: {a: 1, b: 2}  # whole\n"
    )
    found = read_remarks(file)
    assert found.text == {
        ("key",): "behind", ("plain",): "Above, two lines.", ("part",): "of all", ("part", "unit"): "s",
        ("part", "long"): "begins, goes on", ("part", "inline"): "whole",
    }  # fmt: skip
    assert found.inline == {("part", "inline")}
    assert described(("part", "bare"), found) == "of all" and described(("part", "unit"), found) == "s; of all"
