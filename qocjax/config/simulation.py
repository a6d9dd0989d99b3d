"""Configuration of a simulation, and how it becomes a scenario, a design, rules and a network."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from qocjax import _checks
from qocjax._room import results_size
from qocjax.config.cell import CellConfig
from qocjax.config.controller import ControllerConfig, map_of
from qocjax.config.network import DdsConfig, NetworkConfig
from qocjax.config.options import number_at
from qocjax.config.part import Part
from qocjax.config.robot import RobotConfig
from qocjax.controllers import Controller
from qocjax.navigation import StaticMap
from qocjax.network import Network, faster_than_measured
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario
from qocjax.tunables import DESIGN, LOOP, NETWORK, ROBOT, Tunable, by_name

__all__ = ["SimulationConfig"]


class LoopConfig(Part):
    """Sampling period and what completed and missed loops do."""

    tau: float
    actuation: str
    hold: str
    hold_timeout: float
    hold_decay: float
    plan_length: int | None = None
    command_bytes: int = 16

    def build(self) -> Rules:
        """Rules of actuation and hold."""
        return Rules(self.actuation, self.hold, self.hold_timeout, self.hold_decay, self.plan_length)

    @property
    def plan_bytes(self) -> int:
        """By how much a packet is larger than a message with one command."""
        size = _checks.count("loop.command_bytes", self.command_bytes)
        return 0 if self.hold != "buffer" else ((self.build().plan_length or 1) - 1) * size


class ReferenceConfig(Part):
    """The yardstick."""

    kind: str
    kappa: float
    v_max: float
    per_robot: bool


class ScenarioConfig(Part):
    """Start, goal and yardstick."""

    start: list[list[float]]
    goal: list[float] | list[list[float]]
    horizon: float
    reference: ReferenceConfig
    normaliser: str
    weights: list[float]
    start_jitter: list[float]
    map: str | None
    map_release: str

    def build(self, robot: RobotConfig) -> Scenario:
        """The scenario of these robots."""
        if len({len(pose) for pose in self.start}) > 1:
            raise ValueError(f"start: got poses of different lengths {self.start}, expected [x, y, heading] each")
        return Scenario(
            start=np.array(self.start, float).reshape(-1, 3) if not self.start else np.array(self.start, float),
            goal=np.array(self.goal, float),
            horizon=self.horizon,
            reference=self.reference.kind,
            nominal_kappa=self.reference.kappa,
            nominal_v_max=self.reference.v_max,
            reference_per_robot=self.reference.per_robot,
            normaliser=self.normaliser,
            weights=np.array(self.weights, float),
            start_jitter=tuple(self.start_jitter),  # type: ignore[arg-type]
            robot_radius=robot.radius,
            robot=robot.build(),
        )


_LONG = 5.0  # s, a period or a computation that nobody steers a robot with


class SimulationConfig(Part):
    """What every command line simulates: robots, controller, loop, scenario and network."""

    robot: RobotConfig
    controller: ControllerConfig
    loop: LoopConfig
    scenario: ScenarioConfig
    network: NetworkConfig
    key: Annotated[int, Field(ge=-(2**31), lt=2**31)]

    usual_discipline: ClassVar[str] = "unlimited"
    """Of the edge, where the configuration leaves it open."""

    def remarks(self) -> list[str]:
        """Times of many seconds, where milliseconds may be meant."""
        compute = getattr(self.network, "compute", None)
        times = {"loop.tau": self.loop.tau, "network.compute": getattr(compute, "value", None)}  # of a constant law
        return [
            f"{name}: {value:g} is in seconds; {value:g} ms are {name}={value / 1e3:g}"
            for name, value in times.items()
            if isinstance(value, (int, float)) and value >= _LONG
        ]

    def runs_size(self, designs: float, seeds: float | None) -> float:
        """Bytes of the metrics of so many runs."""
        return results_size(designs, seeds or 0, len(self.scenario.start))

    def build_scenario(self) -> Scenario:
        """Robots and yardstick."""
        return self.scenario.build(self.robot)

    def build_network(self) -> Network:
        """Where loop times come from; reads files where it names any."""
        network, edge = self.network, getattr(self.network, "edge", None)
        if edge is not None and edge.discipline is None:
            edge = edge.model_copy(update={"discipline": self.usual_discipline})
            network = network.model_copy(update={"edge": edge})
        return _carrying(network, self.loop.plan_bytes).build()

    def rate_remark(self, network: Network, tau: float) -> str | None:
        """What is wrong with replaying a measured trace every `tau` s; None where nothing is, or it is allowed."""
        allowed = getattr(self.network, "faster_than_measured", False)
        return None if allowed else faster_than_measured(network, tau)

    def check_rate(self, network: Network, tau: float) -> None:
        """Refuses to replay a measured trace faster than it was measured, unless that is allowed.

        Raises:
            ValueError: `tau` (s) is shorter than the trace's period.
        """
        if (remark := self.rate_remark(network, tau)) is not None:
            raise ValueError(remark)

    def build_controller(self) -> Controller:
        """What computes the commands; reads the scenario's map where it has one and the controller asks for it."""
        return self.controller.build(
            self.build_scenario(), self.scenario.map, self.robot.omega_max, self.scenario.map_release
        )

    def build_map(self) -> StaticMap | None:
        """The map that the scenario names; None on open floor.

        Raises:
            ValueError: There is no such file, or it is no map.
        """
        if self.scenario.map is None:
            return None
        return map_of(self.build_scenario(), self.scenario.map, release=self.scenario.map_release)

    def tunables(self) -> dict[str, Tunable]:
        """What the parts declare may be chosen, by name in a design."""
        return by_name((*ROBOT, *LOOP, *NETWORK, *self.controller.declares().tunables))

    def baseline_with(self, names: Iterable[str]) -> Design:
        """The baseline with values of some parameters, by name in a design, beside the model's own.

        Raises:
            ValueError: One is no number of the configuration.
        """
        others = {name: number_at(self, name) for name in names if name not in DESIGN}
        return replace(self.baseline(), others=others)

    def surrogate_only(self) -> None:
        """For commands that need the surrogate law.

        Raises:
            ValueError: The controller is another.
        """
        if self.controller.law != "apf":
            raise ValueError(f"controller: got {self.controller.law}, expected apf, whose gains this command varies")

    def baseline(self) -> Design:
        """The design around which parameters are swept."""
        self.robot.check()
        caps = {"v_max": self.robot.v_max, "omega_max": self.robot.omega_max}
        return Design.of(caps | {"tau": self.loop.tau} | self.controller.gains())


def _carrying(network: NetworkConfig, more: int) -> NetworkConfig:
    """A network whose messages with commands are larger (bytes), where it knows how large they are."""
    if not more:
        return network
    if isinstance(network, CellConfig):
        size: dict[str, float] = {"message_bytes": network.downlink.message_bytes + more}
    elif isinstance(network, DdsConfig):
        size = {"payload": network.downlink.payload + more}
    else:
        return network
    return network.model_copy(update={"downlink": network.downlink.model_copy(update=size)})
