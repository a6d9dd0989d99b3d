"""Configuration of `python -m qocjax.fleet`, and the study that it makes of each fleet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from qocjax import _checks
from qocjax._room import results_size
from qocjax.config.cell import CellConfig
from qocjax.config.controller import ControllerConfig
from qocjax.config.delay import EdgeConfig
from qocjax.config.engine import EngineConfig
from qocjax.config.kept import KeptConfig
from qocjax.config.network import NetworkConfig
from qocjax.config.part import Part
from qocjax.config.robot import RobotConfig
from qocjax.config.simulation import LoopConfig, ReferenceConfig, ScenarioConfig
from qocjax.config.study import StudyConfig
from qocjax.fleets.layout import Layout
from qocjax.fleets.limits import Asked
from qocjax.fleets.point import BEST
from qocjax.network.demand import BANDWIDTH_PARTS
from qocjax.quality import QocScale

__all__ = ["FleetConfig"]


class LayoutConfig(Part):
    """Where robots start and go."""

    kind: str
    spacing: float
    length: float

    def build(self) -> Layout:
        """The layout."""
        return Layout(self.kind, self.spacing, self.length)


class MapConfig(Part):
    """Fleets and what they are given, for dimensioning; an empty list leaves a map out."""

    robots: list[int]
    prbs: list[int]
    workers: list[int]


class FleetOptions(Part):
    """Fleets, what is asked of them, and on which seeds."""

    robots: list[int]
    layout: LayoutConfig
    horizon: float
    start_jitter: list[float]
    deadline_ms: list[float]
    grids: dict[str, list[float]]
    seeds: int
    evaluation_seeds: int
    target: float | None
    target_share: float
    max_collision_share: float
    min_reliability: float
    j_med: float | None
    j_max: float | None
    map: MapConfig
    steps: bool


class FleetConfig(KeptConfig):
    """Everything that `python -m qocjax.fleet` reads."""

    robot: RobotConfig
    controller: ControllerConfig
    loop: LoopConfig
    network: NetworkConfig
    key: Annotated[int, Field(ge=-(2**31), lt=2**31)]
    fleet: FleetOptions
    engine: EngineConfig
    figures: bool
    report: bool
    chunk_steps: Annotated[float, Field(gt=0)]

    usual_discipline: ClassVar[str] = "skip"

    def sizes(self) -> dict[str, float]:
        """Of one run of the largest fleet, and of the runs of one robot."""
        part = self.fleet
        return {
            "fleet.robots": results_size(1, 1, max(self.fleet.robots, default=1)),
            "fleet.map.robots": results_size(1, 1, max(part.map.robots, default=1)),
            "fleet.seeds": results_size(1, part.seeds),
            "fleet.evaluation_seeds": results_size(1, part.evaluation_seeds),
        }

    def check(self) -> None:
        """Checks all that is asked before anything is simulated.

        Raises:
            ValueError: Fleets that do not ascend, a network that says nothing of more robots, a bad target, or what
                some study of some fleet would refuse.
        """
        if self.controller.law != "apf":
            raise ValueError(f"controller: got {self.controller.law}, expected apf: fleets drive on open floor")
        if self.network.kind == "trace":
            raise ValueError("network: got a trace, which says nothing of robots that it did not contain, expected a "
                             "network that is shared: cell, or loop, kth_5g, dds or paper with an edge")  # fmt: skip
        self._check_counts()
        self._check_asked()
        if BEST in self.fleet.grids:
            raise ValueError(f"fleet.grids: got {BEST}, expected other parameters: each fleet has one sampling period")
        last = [{option: amounts[-1]} for option, amounts in self.axes().values()]
        for changes in ({}, *last, *(self.steps().values() if self.fleet.steps else ())):
            study = self.study(self.fleet.robots[0], self.scale(), changes, self.fleet.grids)
            study.build_network(), study.build_scenario(), study.build_grid(), study.loop.build()

    def _check_counts(self) -> None:
        options = self.fleet
        for name, values in (("robots", options.robots), ("map.robots", options.map.robots),
                             ("map.prbs", options.map.prbs), ("map.workers", options.map.workers)):  # fmt: skip
            for value in values:
                _checks.count(f"fleet.{name}", value)
            if sorted(set(values)) != values or (name == "robots" and not values):
                raise ValueError(f"fleet.{name}: got {values}, expected whole numbers that ascend")
        for name in ("seeds", "evaluation_seeds"):
            _checks.count(f"fleet.{name}", getattr(options, name), least=2)

    def _check_asked(self) -> None:
        options = self.fleet
        Asked(1.0 if options.target is None else options.target, options.max_collision_share)
        _checks.bounded("fleet.target_share", options.target_share, above=0.0, most=1.0)
        _checks.bounded("fleet.min_reliability", options.min_reliability, least=0.0, most=1.0)

    def scale(self) -> QocScale | None:
        """J_med and J_max where both are given.

        Raises:
            ValueError: Only one is.
        """
        given = (self.fleet.j_med, self.fleet.j_max)
        if (given[0] is None) != (given[1] is None):
            raise ValueError(f"fleet.j_med, fleet.j_max: got {given[0]} and {given[1]}, expected both or neither")
        return None if given[0] is None or given[1] is None else QocScale(given[0], given[1])

    def axes(self) -> dict[str, tuple[str, list[int]]]:
        """What the maps give to fleets: the option that says how much, and its values."""
        options = self.fleet.map
        found = {"prbs": ("network.prbs", options.prbs if isinstance(self.network, CellConfig) else []),
                 "workers": ("network.edge.workers", options.workers if self._edge() else [])}  # fmt: skip
        return {given: axis for given, axis in found.items() if axis[1] and options.robots}

    def study(self, num_robots: int, scale: QocScale | None, changes: Mapping[str, Any] | None = None,
              grids: Mapping[str, list[float]] | None = None) -> StudyConfig:  # fmt: skip
        """The study of one fleet.

        Args:
            num_robots: N.
            scale: J_med and J_max; None for those of the study itself.
            changes: Options that differ, by their dotted name.
            grids: What the policies tune; none for the baseline at its best deadline alone.
        """
        options, raw = self.fleet, self.model_dump()
        for name, value in {**self._discipline(), **(changes or {})}.items():
            _put(raw, name.split("."), value)
        return StudyConfig.model_validate({
            **{name: raw[name] for name in ("robot", "controller", "loop", "network", "key", "engine", "chunk_steps")},
            "scenario": self._scenario(num_robots).model_dump(),
            "sweep": {
                "grids": {BEST: [raw["loop"]["tau"]], **(grids or {})}, "deadline_ms": options.deadline_ms,
                "seeds": options.seeds, "evaluation_seeds": options.evaluation_seeds,
                "min_reliability": options.min_reliability,
                "j_med": None if scale is None else scale.median, "j_max": None if scale is None else scale.largest,
                "j_max_of": "still", "scale": None,
            },
            "max_collision_share": options.max_collision_share, "nav2": None,
            "figures": False, "report": False, "arrays": False, "resume": None,
        })  # fmt: skip

    def _scenario(self, num_robots: int) -> ScenarioConfig:
        """A fleet on open floor; the yardstick of each robot is its own way at the gains as given."""
        start, goal = self.fleet.layout.build().place(num_robots)
        yardstick = ReferenceConfig(
            kind="nominal", kappa=self.controller.gains()["kappa"], v_max=self.robot.v_max, per_robot=True
        )
        return ScenarioConfig(
            start=start.tolist(), goal=goal.tolist(), horizon=self.fleet.horizon, reference=yardstick,
            normaliser="goal_distance", weights=[1.0, 1.0], start_jitter=self.fleet.start_jitter, map=None,
            map_release="jazzy",
        )  # fmt: skip

    def steps(self) -> dict[str, dict[str, Any]]:
        """Changes of one step each, by what a reader calls them."""
        tau, network = self.loop.tau, self.network
        found: dict[str, dict[str, Any]] = {
            f"τ {2e3 * tau:g} ms": {"loop.tau": 2.0 * tau}, f"τ {5e2 * tau:g} ms": {"loop.tau": 0.5 * tau}
        }  # fmt: skip
        edge = self._edge()
        if edge is not None:
            found[f"{edge.workers + 1} workers"] = {"network.edge.workers": edge.workers + 1}
            other = "latest" if (edge.discipline or self.usual_discipline) != "latest" else "skip"
            found[f"discipline {other}"] = {"network.edge.discipline": other}
        if isinstance(network, CellConfig):
            size = network.uplink.message_bytes
            found[f"uplink messages of {size / 2:g} bytes"] = {"network.uplink.message_bytes": size / 2}
            found |= _more_blocks(network)
            found["all sample at once" if network.stagger else "staggered sampling"] = {
                "network.stagger": not network.stagger
            }
        return found

    def _edge(self) -> EdgeConfig | None:
        """The edge, where it has a limit."""
        edge = getattr(self.network, "edge", None)
        return None if edge is None or edge.discipline == "unlimited" else edge

    def _discipline(self) -> dict[str, Any]:
        """The edge's discipline, where it is left open."""
        edge = getattr(self.network, "edge", None)
        open_ = edge is not None and edge.discipline is None
        return {"network.edge.discipline": self.usual_discipline} if open_ else {}


def _put(raw: dict[str, Any], path: list[str], value: Any) -> None:
    for part in path[:-1]:
        raw = raw[part]
    raw[path[-1]] = value


def _more_blocks(cell: CellConfig) -> dict[str, dict[str, Any]]:
    """Twice the resource blocks, or as many as there are; a wider bandwidth part where all are in use."""
    parts = BANDWIDTH_PARTS.get(cell.numerology, {})
    most = parts.get(cell.bandwidth_mhz, 0)
    if cell.prbs is not None and cell.prbs < most:
        more = min(2 * cell.prbs, most)
        return {f"{more} PRBs": {"network.prbs": more}}
    wider = [width for width, blocks in parts.items() if blocks >= 2 * most] or [max(parts, default=0)]
    if wider[0] <= cell.bandwidth_mhz:
        return {}
    return {f"{parts[wider[0]]} PRBs": {"network.prbs": None, "network.bandwidth_mhz": wider[0]}}
