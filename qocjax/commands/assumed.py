"""What a user gave of what advice is about, and what is assumed in place of the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qocjax.commands.robot_seen import robot_text
from qocjax.config.advise import AdviseConfig

__all__ = ["Given", "assumed_text", "given_of"]


@dataclass(frozen=True)
class Given:
    """Which of the parts somebody gave, or a value of it."""

    robot: bool = True
    scenario: bool = True
    gains: bool = True
    deadline: bool = True

    @property
    def own(self) -> str:
        """What the recommended is compared with; `yours` only where something of it was given."""
        return "yours" if self.gains or self.deadline else "what is assumed"

    @property
    def design(self) -> str:
        """The same as an adjective, for tables."""
        return "current" if self.gains or self.deadline else "assumed"

    @property
    def of_gains(self) -> str:
        """The gains it has."""
        return "your gains" if self.gains else "default gains"


def given_of(config: AdviseConfig, asked: AdviseConfig, options: Sequence[str]) -> Given:
    """What was given, of a run that begins by its options, of one that goes on by what differs from the defaults.

    Args:
        config: What is advised on.
        asked: What the command line says; another than `config` where a run goes on by its folder's configuration.
        options: Names of the options given.
    """
    deadline = config.advise.deadline_ms is not None
    if config is not asked:
        same_law = config.controller.law == asked.controller.law
        scenes = [each.scenario.model_dump(exclude={"reference"}) for each in (config, asked)]  # that follows the robot
        return Given(config.robot != asked.robot, scenes[0] != scenes[1],
                     same_law and config.controller != asked.controller, deadline)  # fmt: skip
    heads = {name.partition(".")[0] for name in options}
    all_of = "experiment" in heads
    gains = any(name.startswith("controller.") for name in options)
    return Given(all_of or "robot" in heads, all_of or "scenario" in heads, all_of or gains, deadline)


def assumed_text(seen: str, config: AdviseConfig, given: Given, presets: tuple[str, str]) -> str:
    """Which robots and scenario are assumed, behind what a bag shows; empty where nothing is.

    Args:
        seen: Of the robot of a bag; empty where there is none.
        config: What is advised on.
        given: What of it was given.
        presets: Names of the robot and the scenario.
    """
    count = len(config.scenario.start)
    robots = f"{count} robot{'' if count == 1 else 's'}"
    parts = [seen] if seen else []
    if not (seen or given.robot):
        parts.append(f"not given: assumed is robot={presets[0]}, {robot_text(config.robot)}; set robot=... "
                     "(turtlebot3_burger, turtlebot4, ...), robot.v_max=... or nav2=FILE.")  # fmt: skip
    elif not (seen or given.scenario):
        parts.append("as given.")
    if not given.scenario:
        parts.append(f"Scenario not given: assumed are {robots}, as in scenario={presets[1]}; set scenario=... (single "
                     "for one robot).")  # fmt: skip
    return " ".join(parts)
