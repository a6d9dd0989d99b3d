"""What most laws have in common, so that a new one is its command alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

import numpy as np
from jax import Array

from qocjax import _checks
from qocjax.controllers.interface import Sight, Task
from qocjax.network.schedule import Rules
from qocjax.robots import Command, Pose
from qocjax.scenario import Design, Scenario
from qocjax.tunables import Tunable

__all__ = ["Law", "check_unread"]


class Law(ABC):
    """A law that remembers nothing, reports nothing and can start everywhere, as far as a subclass does not say more.

    A subclass is a frozen dataclass, as programs are compiled for it, and has to write `command`. What it reads is in
    `task.design` (gains and caps), `task.goal` and `sight`; see `Controller` for all that it may say of itself.
    """

    costly: bool = False
    unread: tuple[str, ...] = ()
    sees_speed: bool = False
    smooth: bool = False
    tunables: tuple[Tunable, ...] = ()

    def check(self, scenario: Scenario, designs: Design, rules: Rules) -> None:
        """Checks that no value is varied that it or the robot does not read.

        Raises:
            ValueError: One is.
        """
        check_unread(self.unread, designs, type(self).__name__)
        check_unread(scenario.robot.unread, designs, f"the robot ({type(scenario.robot).__name__})")

    def check_start(self, scenario: Scenario, start: np.ndarray, seeds: np.ndarray) -> None:  # noqa: B027
        """It can start everywhere."""

    def begin(self, task: Task, pose: Pose, keys: Array | None) -> Any:
        """Nothing."""
        return ()

    @abstractmethod
    def command(self, task: Task, memory: Any, sight: Sight) -> tuple[Any, Command, Any]:
        """The law at one sampling instant; see `Controller`."""

    def report(self, memory: Any) -> dict[str, Array]:
        """Nothing beside the metrics."""
        return {}


def check_unread(unread: Iterable[str], designs: Design, law: str) -> None:
    """Checks that values that a law does not read are the same in all designs.

    Args:
        unread: Their names.
        designs: Numbers, or arrays [G].
        law: Its name, for the message.

    Raises:
        ValueError: One differs.
    """
    for name in unread:
        value = getattr(designs, name)
        if _checks.is_concrete(value) and np.unique(np.asarray(value)).size > 1:
            raise ValueError(f"{name}: got several values, but {law} does not read it, expected one value")
