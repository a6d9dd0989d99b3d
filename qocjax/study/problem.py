"""What a study simulates: designs, and the set-up that each of them runs in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from qocjax.controllers import Controller
from qocjax.network.interface import Network, Reliability
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario
from qocjax.statistics.units import joined, units_of
from qocjax.store.identity import content_digest
from qocjax.store.sources import source_of
from qocjax.study.reliability import reliability_of

__all__ = ["Problem", "Setup", "data_of"]


@dataclass(frozen=True)
class Setup:
    """What compiled programs are made for: everything but the numbers of a design."""

    scenario: Scenario
    network: Network
    rules: Rules
    controller: Controller | None = None


@dataclass(frozen=True)
class Problem:
    """What is simulated, whole: what every chunk of a study needs beside its own description.

    Attributes:
        configuration: The resolved options that it was built from, plain values (JSON), from which another process
            builds it again; None where it was built by hand.
        rebuilt: Function that does; found by its module and name in the other process.
        setups: Where `designs.others` hold values that a program is made for and does not take as an array: the set-up
            of each combination of them, in the order of `apart`. That of the problem itself is the baseline's.
        apart: Names of these values.
    """

    scenario: Scenario
    designs: Design  # each value [G]
    network: Network
    rules: Rules
    key: int
    controller: Controller | None = None
    configuration: Mapping[str, Any] | None = None
    rebuilt: Callable[[Mapping[str, Any]], Problem] | None = None
    setups: Mapping[tuple[float, ...], Setup] = field(default_factory=dict)
    apart: tuple[str, ...] = ()

    def data(self) -> str:
        """Digest of what it holds beside its options: measured delays, maps, files of a law or robot from outside."""
        others = {repr(key): (setup.network, setup.controller) for key, setup in self.setups.items()}
        return data_of(self.scenario, self.network, self.controller, others)

    @property
    def baseline(self) -> Setup:
        """The set-up of the configuration as it stands."""
        return Setup(self.scenario, self.network, self.rules, self.controller)

    def setup_of(self, design: Design) -> Setup:
        """The set-up of one design, whose values are numbers."""
        if not self.apart:
            return self.baseline
        return self.setups[tuple(float(np.asarray(design.others[name])) for name in self.apart)]

    def numbers(self, designs: Design) -> Design:
        """Designs without the values that their set-up holds."""
        return Design.of({name: value for name, value in designs.values().items() if name not in self.apart})

    def groups(self, designs: Design) -> Iterator[tuple[np.ndarray, Setup]]:
        """The places of designs [G] that share a set-up, ascending, with it."""
        count = np.size(designs.tau)
        if not self.apart:
            yield np.arange(count), self.baseline
            return
        columns = np.stack([np.broadcast_to(designs.others[name], count) for name in self.apart], axis=1)
        distinct, place = np.unique(columns, axis=0, return_inverse=True)
        for k, values in enumerate(distinct):
            yield np.flatnonzero(place.ravel() == k), self.setups[tuple(values.tolist())]

    def units(self, seeds: Sequence[int]) -> np.ndarray:
        """Which seeds share an observation, [S], see `units_of`; with several networks in any of them."""
        return joined([
            units_of(setup.network, seeds, self.key, setup.scenario.horizon, self.designs.at(places).tau)
            for places, setup in self.groups(self.designs)
        ])  # fmt: skip

    def reliability(self) -> Reliability:
        """F(Delta) of each design, [G]."""
        share, error = np.empty(np.size(self.designs.tau)), np.empty(np.size(self.designs.tau))
        for places, setup in self.groups(self.designs):
            some = self.designs.at(places)
            share[places], error[places] = reliability_of(setup.network, setup.scenario, some.deadline, some.tau)
        return Reliability(share, error)


def data_of(
    scenario: Scenario, network: Network, controller: Controller | None, others: Mapping[str, Any] | None = None
) -> str:
    """Digest of what lies behind options: measured delays, maps, files of a law or robot from outside.

    Args:
        scenario: Of which the robot counts.
        network: Where loop times come from.
        controller: None for the surrogate law.
        others: What else holds some.
    """
    sources = [source_of(each) for each in (controller, scenario.robot)]
    own = (network, controller, *(each.get("digest") for each in sources if each is not None))
    return content_digest((*own, others) if others else own)
