"""Parameters of the local controller."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from qocjax._checks import bounded, choice, count
from qocjax.navigation.critics import (
    ConstraintCritic,
    CostCritic,
    Critic,
    GoalAngleCritic,
    GoalCritic,
    PreferForwardCritic,
)
from qocjax.navigation.path_critics import PathAlignCritic, PathFollowCritic

__all__ = ["MOTION_MODELS", "MppiConfig"]

MOTION_MODELS = ("DiffDrive", "Omni", "Ackermann")

_DEFAULT_CRITICS: tuple[Critic, ...] = (
    ConstraintCritic(),
    CostCritic(),
    GoalCritic(),
    GoalAngleCritic(),
    PathAlignCritic(),
    PathFollowCritic(),
    PreferForwardCritic(),
)


@dataclass(frozen=True)
class MppiConfig:
    """Parameters with Nav2's names and defaults (docs.nav2.org, Model Predictive Path Integral Controller).

    Frozen and hashable: a program is compiled for it. Nav2's `regenerate_noises` is the caller's choice: a new key each
    cycle, or the same one.

    Attributes:
        batch_size: K, rollouts of an iteration.
        time_steps: H, steps of a rollout.
        model_dt: Length of a step (s).
        iteration_count: Iterations of sampling and weighting in a cycle.
        vx_max: Largest speed (m/s).
        vx_min: Smallest speed, negative to drive backwards (m/s).
        wz_max: Largest rate of turn, either way (rad/s).
        motion_model: DiffDrive, Omni, which moves sideways too, or Ackermann, which turns on circles alone.
        vy_max: Largest speed to either side (m/s); of Omni.
        min_turning_r: Radius of the tightest circle (m); of Ackermann. Rollouts may turn more tightly, at the
            ConstraintCritic's price; the sequence may not.
        ax_max: Most acceleration, ahead or backwards (m/s²); None for no limit.
        ax_min: Most braking, negative (m/s²); None for no limit.
        az_max: Most change of the rate of turn, either way (rad/s²); None for no limit.
        ay_max: Most acceleration to either side (m/s²); None for no limit; of Omni.
        ay_min: Most braking of that, negative (m/s²); None for no limit; of Omni.
        vx_std: Standard deviation of the sampled speed (m/s); 0 to sample none.
        wz_std: Standard deviation of the sampled rate of turn (rad/s); 0 to sample none.
        vy_std: Standard deviation of the sampled speed to the side (m/s); 0 to sample none; of Omni.
        temperature: Of the weights exp(-cost / temperature).
        gamma: Weight of the control cost, γ/σ² Σ u·ε.
        clamp_raw_controls: Whether what is averaged is what the rollouts drove within the limits on acceleration, as
            in Nav2's Jazzy and Kilted, and not the samples as drawn.
        sgf_order: Polynomial order of the Savitzky-Golay filter over 9 commands that smooths the sequence; 0 for none.
            As in Nav2, a sequence of 20 commands or fewer is not smoothed.
        controller_frequency: Cycles per second, which says how far the sequence is shifted (1/s).
        prune_distance: How far along the path the controller sees (m).
        path_spacing: Between the points at which the path is read (m); Nav2 takes the planner's own points.
        stop_if_blocked: Whether the robot stops, and the sequence is reset, where every rollout collides; the first
            command of the sequence is sent nonetheless if not.
        critics: Costs of a rollout, added up.
    """

    batch_size: int = 1000
    time_steps: int = 56
    model_dt: float = 0.05
    iteration_count: int = 1
    vx_max: float = 0.5
    vx_min: float = -0.35
    wz_max: float = 1.9
    ax_max: float | None = 3.0
    ax_min: float | None = -3.0
    az_max: float | None = 3.5
    vx_std: float = 0.2
    wz_std: float = 0.4
    temperature: float = 0.3
    gamma: float = 0.015
    clamp_raw_controls: bool = False
    sgf_order: int = 2
    controller_frequency: float = 20.0
    prune_distance: float = 1.5
    path_spacing: float = 0.05
    stop_if_blocked: bool = True
    critics: tuple[Critic, ...] = _DEFAULT_CRITICS
    motion_model: str = "DiffDrive"
    vy_max: float = 0.5
    vy_std: float = 0.2
    ay_max: float | None = 3.0
    ay_min: float | None = -3.0
    min_turning_r: float = 0.2

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            TypeError: A value is no number, or no whole number.
            ValueError: A value is out of range; the message names the parameter.
        """
        for name in ("batch_size", "time_steps", "iteration_count"):
            count(name, getattr(self, name), 2 if name == "time_steps" else 1)
        above_zero = (
            "model_dt",
            "temperature",
            "controller_frequency",
            "prune_distance",
            "path_spacing",
            "min_turning_r",
        )
        for name in above_zero:
            bounded(name, getattr(self, name), above=0.0, shape=())
        for name in ("vx_max", "wz_max", "vy_max", "vx_std", "wz_std", "vy_std", "gamma"):
            bounded(name, getattr(self, name), least=0.0, shape=())
        bounded("vx_min", self.vx_min, most=self.vx_max, shape=())
        choice("motion_model", self.motion_model, MOTION_MODELS)
        names = ("ax_max", "ax_min", "ay_max", "ay_min", "az_max")
        for name, endless in ((name, -math.inf if name.endswith("min") else math.inf) for name in names):
            value = getattr(self, name)
            if value is None or value == endless:
                object.__setattr__(self, name, None)
            else:
                bounded(name, value, above=None if endless < 0 else 0.0, most=0.0 if endless < 0 else None, shape=())
        choice("sgf_order", str(self.sgf_order), ("0", "1", "2"))
        if self.path_spacing > self.prune_distance:
            raise ValueError(
                f"path_spacing: got {self.path_spacing}, expected at most prune_distance ({self.prune_distance})"
            )
        if not (isinstance(self.critics, tuple) and self.critics):
            raise ValueError(f"critics: got {self.critics!r}, expected a tuple of at least one critic")
        for critic in self.critics:
            _check_critic(critic)

    @property
    def holonomic(self) -> bool:
        """Whether rollouts move sideways."""
        return self.motion_model == "Omni"


def _check_critic(critic: Critic) -> None:
    """Weights of 0 and more, powers and strides of 1 and more."""
    name = type(critic).__name__
    count(f"{name}.stride", critic.stride)
    for field in fields(critic):  # type: ignore[arg-type]
        value, label = getattr(critic, field.name), f"{name}.{field.name}"
        if field.name in ("cost_power", "trajectory_point_step"):
            count(label, value)
        elif field.name == "offset_from_furthest":
            count(label, value, 0)
        else:
            bounded(label, value, above=0.0 if field.name == "cost_scaling_factor" else None, least=0.0, shape=())
