"""Configuration of the testbed: that of a simulation, with a QoS profile, a link and limits on a run's lateness."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import hydra
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import Field

from experiments.dds_testbed.middlewares import MIDDLEWARES
from experiments.dds_testbed.plan import Plan
from qocjax.config import Part, SimulationConfig, conf_dir, load
from qocjax.controllers import Apf
from qocjax.robots import Unicycle

__all__ = ["TestbedConfig", "read_config", "written_config"]

_FILE = "config.json"

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class QosConfig(Part):
    """What writers offer and readers ask for."""

    reliability: Literal["best_effort", "reliable"]
    depth: Annotated[int, Field(ge=1)] | None
    lifespan_ms: Positive | None


class DdsConfig(Part):
    """What DDS alone has."""

    lease: Positive | None
    heartbeat_period: Positive | None


class OutageConfig(Part):
    """A time without radio, in s from the first sample."""

    begin: NotNegative
    duration: NotNegative


class ZenohConfig(Part):
    """What Zenoh alone has."""

    protocol: Literal["tcp", "udp"]
    congestion: Literal["drop", "block"]
    express: bool


class LimitsConfig(Part):
    """When a run is rejected."""

    relay_p99_ms: Positive
    tick_p99_ms: Positive


class TestbedConfig(SimulationConfig):
    """A run of the testbed."""

    middleware: Literal[MIDDLEWARES]  # type: ignore[valid-type]
    qos: QosConfig
    dds: DdsConfig
    zenoh: ZenohConfig
    deadline_ms: NotNegative
    outage: OutageConfig
    link: Literal["auto", "tap", "veth"]
    in_order: bool
    warm_up: Positive
    cool_down: Positive
    limits: LimitsConfig
    bag: bool
    folder: str

    def build_plan(self, tap: bool, folder: Path) -> Plan:
        """What robots and edge are told.

        Raises:
            ValueError: A rule that the testbed does not know, or a value out of range.
        """
        scenario, rules = self.build_scenario(), self.loop.build()
        if rules.actuation == "instant":
            raise ValueError("loop.actuation: got 'instant', expected what real time allows, 'arrival' or 'deadline'")
        if self.middleware == "zenoh" and self.qos.lifespan_ms is not None:
            raise ValueError(f"qos.lifespan_ms: got {self.qos.lifespan_ms:g}, expected null: Zenoh has no lifespan")
        if self.middleware != "fastdds" and self.dds.heartbeat_period is not None:
            raise ValueError(f"dds.heartbeat_period: got {self.dds.heartbeat_period:g} with {self.middleware}, "
                             "expected null: it is set for Fast DDS only")  # fmt: skip
        if scenario.robot != Unicycle():
            raise ValueError(f"robot: got {scenario.robot}, expected a Unicycle that obeys commands at once, as "
                             "those of the testbed do (robot.ax_max, ax_min and az_max null)")  # fmt: skip
        self._check_controller()
        if not 1 <= scenario.num_robots <= 16:
            raise ValueError(f"scenario.start: got {scenario.num_robots} robots, expected 1 to 16")
        own = (self.zenoh if self.middleware == "zenoh" else self.dds).model_dump()
        design = {name: float(value) for name, value in self.baseline().values().items()}
        return Plan(
            start=self.scenario.start, goal=self.scenario.goal, horizon=scenario.horizon,
            design=design | {"deadline": self.deadline_ms * 1e-3}, rules=vars(rules), middleware=self.middleware,
            options=own, reliable=self.qos.reliability == "reliable",
            depth=self.qos.depth, lifespan=None if self.qos.lifespan_ms is None else self.qos.lifespan_ms * 1e-3,
            warm_up=self.warm_up, cool_down=self.cool_down, tap=tap,
            outage=(self.outage.begin, self.outage.begin + self.outage.duration), folder=str(folder),
        )  # fmt: skip

    def _check_controller(self) -> None:
        controller = self.build_controller()
        if isinstance(controller, Apf):
            return
        if self.middleware != "fastdds":
            raise ValueError(f"controller: got {self.controller.law} with {self.middleware}, expected apf or "
                             "middleware=fastdds, which alone has the odometry that it reads")  # fmt: skip
        if getattr(controller, "predict", False):
            raise ValueError("controller.predict: got true, expected false in the testbed")
        controller.check(self.build_scenario(), self.baseline(), self.loop.build())

    def write(self, folder: Path) -> None:
        """Writes the configuration for the edge."""
        (folder / _FILE).write_text(json.dumps(self.model_dump()), encoding="utf-8")


def written_config(folder: Path) -> TestbedConfig:
    """What `write` has left."""
    return TestbedConfig.model_validate(json.loads((folder / _FILE).read_text(encoding="utf-8")))


def read_config(options: list[str]) -> TestbedConfig:
    """Composes `testbed.yaml` with options of the form `name=value`.

    Raises:
        ValueError: An unknown option, or a wrong value.
    """
    here = Path(__file__).resolve().parent
    try:
        with hydra.initialize_config_dir(str(here), version_base="1.3"):
            cfg = hydra.compose("testbed", [f"hydra.searchpath=[file://{conf_dir()}]", *options])
        OmegaConf.resolve(cfg)
    except (HydraException, OmegaConfBaseException) as error:
        raise ValueError(" ".join(str(error).split())) from None
    return load(TestbedConfig, cfg)
