"""Configuration of `python -m qocjax.ingest`."""

from __future__ import annotations

import math

from qocjax import _checks
from qocjax.config.part import Part
from qocjax.config.robot import RobotConfig
from qocjax.config.robots import presets
from qocjax.quality import QocScale
from qocjax.recorded.folder import Labels
from qocjax.recorded.formats import FORMATS
from qocjax.recorded.judge import Yardstick
from qocjax.recorded.loops import ClockRules
from qocjax.recorded.patterns import words
from qocjax.recorded.pose_tables import PosesFormat
from qocjax.recorded.poses import BEGINNINGS
from qocjax.recorded.run import Rules
from qocjax.recorded.series import Cleaning
from qocjax.recorded.stamps import StampsFormat
from qocjax.recorded.topics import TopicPatterns
from qocjax.scenario import NORMALISERS

__all__ = ["IngestConfig", "ReadingConfig"]

_REFERENCES = ("nominal", "uncapped")


class TopicsConfig(Part):
    """Which topics are whose poses and commands."""

    poses: list[str]
    commands: list[str]
    goals: list[str]
    odometry: list[str]
    footprints: list[str]
    robots: list[str] | None
    same_clock: bool

    def build(self) -> TopicPatterns:
        """The patterns."""
        for pattern in (*self.poses, *self.commands, *self.goals, *self.odometry, *self.footprints):
            if set(words(pattern)) - {"robot"}:
                raise ValueError(f"topics: got {pattern!r}, expected no other word in braces than {{robot}}")
        return TopicPatterns(
            tuple(self.poses),
            tuple(self.commands),
            tuple(self.goals),
            None if self.robots is None else tuple(self.robots),
            tuple(self.odometry),
            tuple(self.footprints),
        )


class QualityConfig(Part):
    """What recorded runs are judged by."""

    goal: list[float] | str | None
    goal_average: float
    starts: dict[str, list[float]] | None
    begin: str | float
    horizon: float | None
    reference: str
    kappa: float
    v_max: float
    per_robot: bool | None
    normaliser: str | None
    weights: list[float]
    d_safe: float
    path_resolution: float
    j_med: float | None
    j_max: float | None

    def build(self, radius: float) -> Yardstick:
        """The yardstick.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("kappa", "v_max", "d_safe", "goal_average"):
            _checks.bounded(f"quality.{name}", getattr(self, name), above=0)
        _checks.bounded("quality.path_resolution", self.path_resolution, least=0)
        _checks.choice("quality.reference", self.reference, _REFERENCES)
        if self.horizon is not None:
            _checks.bounded("quality.horizon", self.horizon, above=0)
        if self.normaliser is not None:
            _checks.choice("quality.normaliser", self.normaliser, NORMALISERS)
        if isinstance(self.begin, str):
            _checks.choice("quality.begin", self.begin, BEGINNINGS)
        else:
            _checks.bounded("quality.begin", self.begin, least=0)
        starts = {name: _numbers(f"quality.starts.{name}", pose, 3) for name, pose in (self.starts or {}).items()}
        weights = _numbers("quality.weights", self.weights, 2)
        _checks.bounded("quality.weights", self.weights, above=0)
        return Yardstick(
            goal=self._goal(), starts=starts or None,
            begin=self.begin, horizon=self.horizon, end=self.goal_average, reference=self.reference, kappa=self.kappa,
            v_max=self.v_max, per_robot=self.per_robot, normaliser=self.normaliser, weights=(weights[0], weights[1]),
            d_safe=self.d_safe, robot_radius=radius, path_resolution=self.path_resolution,
        )  # fmt: skip

    def _goal(self) -> tuple[float, ...] | str | None:
        if isinstance(self.goal, str):
            return _checks.choice("quality.goal", self.goal, ("end",))
        return None if self.goal is None else _numbers("quality.goal", self.goal, 2)

    def scale(self) -> QocScale | None:
        """J_med and J_max where both are given.

        Raises:
            ValueError: Only one is.
        """
        if (self.j_med is None) != (self.j_max is None):
            raise ValueError(
                f"quality.j_med, quality.j_max: got {self.j_med} and {self.j_max}, expected both or neither"
            )
        return None if self.j_med is None or self.j_max is None else QocScale(self.j_med, self.j_max)


class ClockConfig(Part):
    """How the clocks of robot and edge are related."""

    same: bool
    window: float
    largest_uncertainty_ms: float
    step_ms: float


class CleanConfig(Part):
    """From where on something counts as wrong."""

    missing_are_lost: bool
    gap: float
    least_gap: float
    restart: float
    max_speed: float
    max_turn_rate: float


class StampsConfig(Part):
    """How tables of stamps are laid out."""

    sequence: str | None
    uplink_send: str
    edge_receive: str | None
    edge_send: str | None
    downlink_receive: str
    robot: str | None
    session: str | None
    unit: str | None
    files: str
    edge_files: str | None
    edge_columns: list[str] | None
    records: str | None
    separator: str | None

    def build(self) -> StampsFormat:
        """The layout.

        Raises:
            ValueError: The stamps of the edge are named in part.
        """
        if (self.edge_receive is None) != (self.edge_send is None):
            raise ValueError(
                "stamps.edge_receive, stamps.edge_send: got one without the other, expected both or neither"
            )
        if (self.edge_files is None) != (self.edge_columns is None):
            raise ValueError(
                "stamps.edge_files, stamps.edge_columns: got one without the other, expected both or neither"
            )
        edge = self.edge_columns
        if edge is not None and len(edge) != 3:
            raise ValueError(f"stamps.edge_columns: got {edge}, expected [sequence, edge receive, edge send]")
        values = self.model_dump() | {"edge_columns": None if edge is None else (edge[0], edge[1], edge[2])}
        return StampsFormat(**values)


class PosesConfig(Part):
    """How tables of poses are laid out; null for the names that formats have."""

    time: str | None
    x: str | None
    y: str | None
    heading: str | None
    robot: str | None

    def build(self, topics: list[str]) -> PosesFormat:
        """The layout.

        Args:
            topics: Patterns of topics of poses, which tell the robot.

        Raises:
            ValueError: Some names are given without those that they need.
        """
        given = [name for name in ("time", "x", "y") if getattr(self, name) is not None]
        if len(given) not in (0, 3) or (not given and (self.heading is not None or self.robot is not None)):
            raise ValueError("poses.time, poses.x, poses.y: got some without the others, expected all or none")
        return PosesFormat(**self.model_dump(), topics=tuple(topics))


class LabelsConfig(Part):
    """Where the labels of runs come from."""

    pattern: str | None
    file: str | None

    def build(self) -> Labels:
        """The labels."""
        if self.pattern is not None and not words(self.pattern):
            raise ValueError(f"labels.pattern: got {self.pattern!r}, expected a word in braces, such as {{d_cfg_ms}}")
        return Labels.of(self.pattern, self.file)


class ReadingConfig(Part):
    """Where recorded runs lie, and how they are read and judged."""

    path: str
    format: str
    topics: TopicsConfig
    quality: QualityConfig
    stamps: StampsConfig
    poses: PosesConfig
    clock: ClockConfig
    clean: CleanConfig
    labels: LabelsConfig

    def rules(self, radius: float) -> Rules:
        """How runs are read and judged.

        Args:
            radius: Of a robot (m).

        Raises:
            ValueError: A value is out of range.
        """
        _checks.choice("format", self.format, ("auto", *FORMATS))
        clean, clock = self.clean.model_dump(), self.clock
        missing = clean.pop("missing_are_lost")
        for name, value in clean.items():
            _checks.bounded(f"clean.{name}", value, above=0)
        for name in ("window", "largest_uncertainty_ms", "step_ms"):
            _checks.bounded(f"clock.{name}", getattr(clock, name), above=0)
        return Rules(
            self.topics.build(), self.stamps.build(),
            ClockRules(clock.same, clock.window, clock.largest_uncertainty_ms / 1e3, clock.step_ms / 1e3, missing),
            Cleaning(window=clock.window, **clean), self.quality.build(radius), self.topics.same_clock,
            self.poses.build(self.topics.poses), self.format, presets(),
        )  # fmt: skip


class IngestConfig(ReadingConfig):
    """Everything that `python -m qocjax.ingest` reads."""

    robot: RobotConfig
    deadline_ms: list[float]
    figures: bool

    def build(self) -> Rules:
        """How runs are read and judged.

        Raises:
            ValueError: A value is out of range.
        """
        rules = self.rules(self.robot.radius)
        if not self.deadline_ms or not all(math.isfinite(ms) and ms >= 0 for ms in self.deadline_ms):
            raise ValueError(f"deadline_ms: got {self.deadline_ms}, expected one or more finite numbers >= 0")
        return rules


def _numbers(name: str, values: list[float], count: int) -> tuple[float, ...]:
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name}: got {values}, expected {count} finite numbers")
    return tuple(values)
