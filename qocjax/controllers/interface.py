"""What a controller is: it computes the command of each robot from what is known at a sampling instant."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from jax import Array

from qocjax._math import AngleMath
from qocjax.network.schedule import Rules
from qocjax.robots import Command, Pose, Robot, Unicycle
from qocjax.scenario import Design, Scenario
from qocjax.tunables import Tunable

__all__ = ["Controller", "Sight", "Task"]


class Task(NamedTuple):
    """What does not change over a run; `*B` is the batch."""

    goal: tuple[Array, Array]  # the coordinates of p*, each broadcastable to [N, *B] (m)
    design: Design  # values broadcastable to [N, *B]; tau and deadline are scalars
    math: AngleMath
    ticks: int  # P
    lag: Array  # whole sampling periods of the deadline
    rest: Array  # of the deadline (s)
    slots: int  # most commands that are under way at once; 0 where the loop has no buffer
    robot: Robot = Unicycle()  # what kind of robot they are


class Sight(NamedTuple):
    """What is known at the sampling instant t_p."""

    tick: Array  # p
    pose: Pose  # sampled, each field [N, *B]
    age: Array  # of information, broadcastable to [N, *B] (s)
    speed: Command | None  # at which they drive as t_p is reached, each field [N, *B]; None where it is not kept
    begin: tuple[Pose, Command | None] | None = None  # pose and speed predicted for t_p + Delta; None where not asked


class Controller(Protocol):
    """A controller; frozen and hashable, since programs are compiled for it.

    One that makes plans in a way of its own has a method `plan` too: `qocjax.controllers.rolled.PlanMaker`. One with
    large arrays has methods `held` and `holding`: `qocjax.controllers.held`.

    Attributes:
        costly: Whether a command takes so long that no run may be simulated for filling up a batch.
        unread: Values of a design that it does not read.
        sees_speed: Whether it reads at what speed robots drive; else the loop need not keep it.
        tunables: What it declares may be chosen. Those that are arrays and no field of a design it reads from
            `task.design.others`, where they are there.
        smooth: Whether its commands have derivatives in the design's values, almost everywhere, that mean something.
    """

    @property
    def costly(self) -> bool:
        """Whether a command takes long."""
        ...

    @property
    def unread(self) -> tuple[str, ...]:
        """Values of a design that it does not read."""
        ...

    @property
    def sees_speed(self) -> bool:
        """Whether it reads at what speed robots drive."""
        ...

    @property
    def tunables(self) -> tuple[Tunable, ...]:
        """What it declares may be chosen."""
        ...

    @property
    def smooth(self) -> bool:
        """Whether its commands can be differentiated."""
        ...

    def check(self, scenario: Scenario, designs: Design, rules: Rules) -> None:
        """Checks what can be known before anything runs.

        Args:
            scenario: Robots, nominal starts and goal.
            designs: Numbers, or arrays [G].
            rules: When commands take effect, and what a missed loop does.

        Raises:
            ValueError: The controller cannot do it; the message says why.
        """
        ...

    def check_start(self, scenario: Scenario, start: np.ndarray, seeds: np.ndarray) -> None:
        """Checks where robots start.

        Args:
            scenario: Robots.
            start: [N, 3, S].
            seeds: [S], for the message.

        Raises:
            ValueError: A robot cannot start there.
        """
        ...

    def begin(self, task: Task, pose: Pose, keys: Array | None) -> Any:
        """What is remembered before the first instant.

        Args:
            task: What does not change.
            pose: Start poses.
            keys: [*B, 2] words of a random key for each run; None if the caller has none.
        """
        ...

    def command(self, task: Task, memory: Any, sight: Sight) -> tuple[Any, Command, Any]:
        """What is remembered next, the commands [N, *B], and what is to be recorded of the instant."""
        ...

    def report(self, memory: Any) -> dict[str, Array]:
        """Numbers about a run, each [N, *B], beside its metrics."""
        ...
