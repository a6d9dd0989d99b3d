"""What a user gave is called his; of the rest advice says what it assumes."""

from __future__ import annotations

import pandas as pd
import pytest
from hydra import compose, initialize_config_dir

from qocjax.commands.advice_page.decision import _question
from qocjax.commands.advice_page.tables import _named
from qocjax.commands.assumed import Given, assumed_text, given_of
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig

PRESETS = ("paper", "paper")


def config_of(*options: str) -> AdviseConfig:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        return load(AdviseConfig, compose("advise", list(options)))


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ([], Given(False, False, False, False)),
        (["robot=turtlebot4"], Given(True, False, False, False)),
        (["robot.v_max=0.5", "scenario=single"], Given(True, True, False, False)),
        (["controller.kappa=1"], Given(False, False, True, False)),
        (["controller=cbf", "advise.deadline_ms=200"], Given(False, False, False, True)),
        (["scenario.horizon=20"], Given(False, True, False, False)),
    ],
)  # fmt: skip
def test_what_is_given_is_told_from_options_and_when_it_goes_on_from_its_values(
    options: list[str], given: Given
) -> None:
    plain, config = config_of(), config_of(*options)
    assert given_of(config, config, [each.partition("=")[0] for each in options]) == given
    assert given_of(config, plain, ["resume"]) == given


def test_an_experiment_gives_all_but_the_deadline() -> None:
    config = config_of()
    assert given_of(config, config, ["experiment"]) == Given(True, True, True, False)


def test_assumed_robots_and_scenario_are_said() -> None:
    config = config_of()
    text = assumed_text("", config, Given(False, False, False, False), PRESETS)
    for words in ("not given: assumed is robot=paper, v_max 0.7 m/s", "assumed are 2 robots, as in scenario=paper",
                  "set robot=...", "scenario=... (single"):  # fmt: skip
        assert words in text
    assert assumed_text("", config, Given(), PRESETS) == ""
    assert assumed_text("", config, Given(scenario=False), PRESETS).startswith("as given. Scenario not given: ")
    assert "Scenario" not in assumed_text("", config, Given(robot=False), PRESETS)
    seen = assumed_text("as the bag shows it: v_max 0.2 m/s.", config, Given(False, False), PRESETS)
    assert seen.startswith("as the bag") and "robot=paper" not in seen and "2 robots" in seen


def test_yours_is_what_was_given() -> None:
    nothing, gains, deadline = Given(gains=False, deadline=False), Given(deadline=False), Given(gains=False)
    assert (nothing.own, gains.own, deadline.own) == ("what is assumed", "yours", "yours")
    assert _question("300", nothing).startswith("DEADLINE not given: 300 ms assumed")
    assert _question("300", deadline) == "IS 300 ms ACCEPTABLE?"
    rows = pd.Series(["current", "current gains, recommended deadline", "recommended"])
    assert [_named(what, nothing) for what in rows] == [
        "assumed", "default gains, recommended deadline", "recommended"
    ]  # fmt: skip
    assert _named("current gains, recommended deadline", gains) == "your gains, recommended deadline"
