"""Configuration of `python -m qocjax.qos`."""

from __future__ import annotations

from typing import Any

from qocjax.config.kept import KeptConfig
from qocjax.config.part import Part
from qocjax.config.scale import given_scale
from qocjax.config.simulation import SimulationConfig
from qocjax.network import Edge
from qocjax.network.dds import DdsNetwork, Profile
from qocjax.network.demand import Carrier
from qocjax.network.interface import general_length
from qocjax.quality import QocScale

__all__ = ["QosConfig"]


class CarrierConfig(Part):
    """5G carrier."""

    bandwidth_mhz: int
    numerology: int
    mcs_uplink: int
    mcs_downlink: int

    def build(self) -> Carrier:
        """The carrier."""
        return Carrier(**self.model_dump())


class ShownConfig(Part):
    """The channel of the figures that show one."""

    loss: float
    burst: float


class QosOptions(Part):
    """Axes and seeds."""

    profiles: dict[str, dict[str, Any]]
    loss: list[float]
    burst: list[float]
    deadline_ms: list[float]
    show: ShownConfig
    seeds: int
    j_med: float | None
    j_max: float | None
    scale: str | None


_MESSAGES = 7  # times the bytes of a run, that a tick of both ways takes


class QosConfig(SimulationConfig, KeptConfig):
    """Everything that `python -m qocjax.qos` reads."""

    qos: QosOptions
    carrier: CarrierConfig
    figures: bool

    def sizes(self) -> dict[str, float]:
        """Of the runs of one profile and channel, with its messages both ways."""
        part, ticks = self.qos, self.scenario.horizon / self.loop.tau if self.loop.tau > 0 else 0.0
        messages = _MESSAGES * general_length(int(min(ticks, 1e12)))
        return {"qos.seeds": self.runs_size(max(len(part.deadline_ms), messages), part.seeds)}

    def build_topics(self) -> tuple[DdsNetwork, Edge]:
        """The network, and its edge.

        Raises:
            ValueError: It has no ROS 2 topics.
        """
        network = self.build_network()
        path, edge = getattr(network, "path", network), getattr(network, "edge", Edge())
        if not isinstance(path, DdsNetwork):
            raise ValueError(f"network: got {network.name!r}, expected ROS 2 topics (network=dds)")
        return path, edge

    def profiles(self) -> dict[str, dict[str, Any]]:
        """Changes to the QoS by name.

        Raises:
            ValueError: A profile changes what a profile does not have.
        """
        known = tuple(Profile.__dataclass_fields__)
        for name, changes in self.qos.profiles.items():
            for option in changes:
                if option not in known:
                    raise ValueError(f"qos.profiles.{name}: got {option!r}, expected some of {', '.join(known)}")
        return self.qos.profiles

    def compares_best_effort(self) -> bool:
        """Whether RELIABLE is compared with BEST_EFFORT, as in the paper."""
        first, *others = (changes.get("reliability") for changes in self.qos.profiles.values())
        return first == "best_effort" and "reliable" in others

    def shown(self) -> tuple[float, float]:
        """Loss and burst of the channel to show.

        Raises:
            ValueError: It is not on the axes.
        """
        for name in ("loss", "burst"):
            if getattr(self.qos.show, name) not in getattr(self.qos, name):
                at, axis = getattr(self.qos.show, name), getattr(self.qos, name)
                raise ValueError(f"qos.show.{name}: got {at:g}, expected one of qos.{name}: {axis}")
        return self.qos.show.loss, self.qos.show.burst

    def scale(self) -> QocScale | None:
        """J_med and J_max where they are given, or named by an earlier study.

        Raises:
            ValueError: Only one is given, or the file holds no scale of this yardstick.
        """
        options = self.qos
        return given_scale("qos", options.j_med, options.j_max, options.scale, self.build_scenario())
