"""The typed schema of every configuration, and the one place where a configuration becomes objects.

Hydra composes the YAML files of `conf/`; the models below reject an unknown key and a wrong type; `build` methods turn
them into scenarios, designs, rules and networks. After that no configuration travels.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from omegaconf import DictConfig, OmegaConf
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from qocjax.network import (
    Constant,
    Empirical,
    GilbertElliott,
    IndependentLoss,
    Leg,
    LoopNetwork,
    Network,
    QuantileTable,
    ShiftedGamma,
    ShiftedLogNormal,
    Trace,
    TruncatedNormal,
    kth_5g_network,
    read_histogram,
    read_samples,
    read_trace,
)
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.study.grid import Grid, one_at_a_time

__all__ = ["StudyConfig", "conf_dir", "load"]

M = TypeVar("M", bound=BaseModel)


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class RobotConfig(_Part):
    """Speed caps and size."""

    v_max: float
    omega_max: float
    radius: float


class ControllerConfig(_Part):
    """Gains of the surrogate law at baseline."""

    kappa: float
    eta: float
    gamma: float
    c_miss: float
    d_safe: float


class LoopConfig(_Part):
    """Sampling period and what completed and missed loops do."""

    tau: float
    actuation: str
    hold: str
    hold_timeout: float
    hold_decay: float

    def build(self) -> Rules:
        """Rules of actuation and hold."""
        return Rules(self.actuation, self.hold, self.hold_timeout, self.hold_decay)


class ReferenceConfig(_Part):
    """The yardstick."""

    kind: str
    kappa: float
    v_max: float
    per_robot: bool


class ScenarioConfig(_Part):
    """Start, goal and yardstick."""

    start: list[list[float]]
    goal: list[float] | list[list[float]]
    horizon: float
    reference: ReferenceConfig
    normaliser: str
    weights: list[float]
    start_jitter: list[float]

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
        )


class ConstantDelay(_Part):
    """The same delay for every message."""

    law: Literal["constant"]
    value: float

    def build(self) -> Constant:
        """The law."""
        return Constant(self.value)


class TruncatedNormalDelay(_Part):
    """Normal, cut at `low` and `high`."""

    law: Literal["truncated_normal"]
    mean: float
    std: float
    low: float = 0.0
    high: float = float("inf")

    def build(self) -> TruncatedNormal:
        """The law."""
        return TruncatedNormal(self.mean, self.std, self.low, self.high)


class GammaDelay(_Part):
    """Gamma above a shift."""

    law: Literal["gamma"]
    shift: float
    shape: float
    scale: float

    def build(self) -> ShiftedGamma:
        """The law."""
        return ShiftedGamma(self.shift, self.shape, self.scale)


class LogNormalDelay(_Part):
    """Log-normal above a shift."""

    law: Literal["log_normal"]
    shift: float
    median: float
    sigma: float

    def build(self) -> ShiftedLogNormal:
        """The law."""
        return ShiftedLogNormal(self.shift, self.median, self.sigma)


class SamplesDelay(_Part):
    """A column of measured delays."""

    law: Literal["samples"]
    path: str
    column: str
    unit: str
    separator: str | None = None

    def build(self) -> Empirical:
        """The law."""
        return read_samples(self.path, self.column, self.unit, separator=self.separator)


class HistogramDelay(_Part):
    """A measured histogram (XML, bins in ms)."""

    law: Literal["histogram"]
    path: str

    def build(self) -> QuantileTable:
        """The law."""
        return read_histogram(self.path)


Delay = Annotated[
    ConstantDelay | TruncatedNormalDelay | GammaDelay | LogNormalDelay | SamplesDelay | HistogramDelay,
    Field(discriminator="law"),
]


class IndependentLossConfig(_Part):
    """Each message lost with the same probability."""

    process: Literal["independent"]
    probability: float

    def build(self) -> IndependentLoss:
        """The process."""
        return IndependentLoss(self.probability)


class GilbertElliottConfig(_Part):
    """Losses in bursts."""

    process: Literal["gilbert_elliott"]
    p_good_to_bad: float
    p_bad_to_good: float
    loss_good: float = 0.0
    loss_bad: float = 1.0

    def build(self) -> GilbertElliott:
        """The process."""
        return GilbertElliott(self.p_good_to_bad, self.p_bad_to_good, self.loss_good, self.loss_bad)


class LegConfig(_Part):
    """One direction."""

    delay: Delay
    loss: Annotated[IndependentLossConfig | GilbertElliottConfig, Field(discriminator="process")]

    def build(self) -> Leg:
        """The leg."""
        return Leg(self.delay.build(), self.loss.build())


class LoopNetworkConfig(_Part):
    """Uplink, compute and downlink from a law each."""

    kind: Literal["loop"]
    name: str
    uplink: LegConfig
    compute: Delay
    downlink: LegConfig

    def build(self) -> LoopNetwork:
        """The network."""
        return LoopNetwork(
            uplink=self.uplink.build(), compute=self.compute.build(), downlink=self.downlink.build(), name=self.name
        )


class Kth5gConfig(_Part):
    """Measured private 5G one-way delays around the paper's compute time."""

    kind: Literal["kth_5g"]
    compute_mean: float
    compute_std: float
    uplink_loss: float
    downlink_loss: float

    def build(self) -> LoopNetwork:
        """The network."""
        return kth_5g_network(self.compute_mean, self.compute_std, self.uplink_loss, self.downlink_loss)


class TraceConfig(_Part):
    """A measured trace, replayed in order."""

    kind: Literal["trace"]
    path: str
    column: str
    unit: str
    sequence: str | None = None
    gaps_are_lost: bool = False
    separator: str | None = None
    period: float | None = None

    def build(self) -> Trace:
        """The network."""
        return read_trace(
            self.path,
            self.column,
            self.unit,
            sequence=self.sequence,
            gaps_are_lost=self.gaps_are_lost,
            separator=self.separator,
            period=self.period,
        )


class SweepConfig(_Part):
    """What a study sweeps, and on which seeds."""

    grids: dict[str, list[float]]
    deadline_ms: list[float]
    seeds: int
    evaluation_seeds: int
    min_reliability: float
    j_med: float | None
    j_max: float | None


class StudyConfig(_Part):
    """Everything that `python -m qocjax.sweep` reads."""

    robot: RobotConfig
    controller: ControllerConfig
    loop: LoopConfig
    scenario: ScenarioConfig
    network: Annotated[LoopNetworkConfig | Kth5gConfig | TraceConfig, Field(discriminator="kind")]
    sweep: SweepConfig
    key: Annotated[int, Field(ge=-(2**31), lt=2**31)]
    figures: bool

    def build_scenario(self) -> Scenario:
        """Robots and yardstick."""
        return self.scenario.build(self.robot)

    def build_network(self) -> Network:
        """Where loop times come from; reads files where it names any."""
        return self.network.build()

    def baseline(self) -> Design:
        """The design around which parameters are swept."""
        gains = self.controller.model_dump()
        return Design(v_max=self.robot.v_max, omega_max=self.robot.omega_max, tau=self.loop.tau, **gains)

    def build_grid(self) -> Grid:
        """The designs of the study."""
        return one_at_a_time(self.baseline(), self.sweep.grids, [ms / 1000 for ms in self.sweep.deadline_ms])

    def seeds(self) -> tuple[range, range]:
        """Selection and evaluation seeds: consecutive, so never in both."""
        for name in ("seeds", "evaluation_seeds"):
            if getattr(self.sweep, name) < 2:
                raise ValueError(f"sweep.{name}: got {getattr(self.sweep, name)}, expected at least 2")
        first = self.sweep.seeds
        return range(first), range(first, first + self.sweep.evaluation_seeds)

    def scale(self) -> QocScale | None:
        """J_med and J_max where both are given.

        Raises:
            ValueError: Only one is.
        """
        given = (self.sweep.j_med, self.sweep.j_max)
        if (given[0] is None) != (given[1] is None):
            raise ValueError(f"sweep.j_med, sweep.j_max: got {given[0]} and {given[1]}, expected both or neither")
        return None if given[0] is None or given[1] is None else QocScale(given[0], given[1])


def load(model: type[M], cfg: DictConfig) -> M:
    """Checks a composed configuration against its schema.

    Raises:
        ValueError: An unknown key, a missing one or a wrong type; one line for each, with its full name.
    """
    if missing := sorted(OmegaConf.missing_keys(cfg)):
        raise ValueError("; ".join(f"{name}: got nothing, expected a value" for name in missing))
    raw: Any = OmegaConf.to_container(cfg, resolve=True)
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        lines = [_line(item, raw) for item in error.errors()]
        raise ValueError("; ".join(lines)) from None


def _line(item: Any, raw: Any) -> str:
    """One schema error as a line; the tags that pydantic adds for the branch of a union are left out."""
    path, here = [], raw
    for part in item["loc"]:
        if isinstance(here, dict) and part in here or isinstance(here, list) and isinstance(part, int):
            here = here[part]
        elif part != item["loc"][-1]:
            continue
        path.append(str(part))
    name = ".".join(path)
    if item["type"] == "extra_forbidden":
        return f"{name}: got an unknown option, expected one of the configuration's"
    if item["type"] == "missing":
        return f"{name}: got nothing, expected a value"
    return f"{name}: got {item['input']!r}, expected {item['msg'].removeprefix('Input should be ')}"


def conf_dir() -> Path:
    """Folder of the YAML files: inside an installed package, or beside the package in a checkout."""
    packaged = Path(str(resources.files("qocjax"))) / "conf"
    return packaged if packaged.is_dir() else packaged.parent.parent / "conf"
