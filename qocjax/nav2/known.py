"""Classes of plugins and critics of Nav2 that have a counterpart here, by the names that parameter files give."""

from __future__ import annotations

__all__ = ["CRITICS", "DWB", "HANDLER", "INFLATION", "MPPI", "RPP", "SHIM", "SIMPLE_GOAL", "goal_checker"]

MPPI = "nav2_mppi_controller::MPPIController"
DWB = "dwb_core::DWBLocalPlanner"
RPP = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
SHIM = "nav2_rotation_shim_controller::RotationShimController"
INFLATION = "nav2_costmap_2d::InflationLayer"
HANDLER = "nav2_controller::FeasiblePathHandler"  # from Lyrical on
SIMPLE_GOAL = "nav2_controller::SimpleGoalChecker"

CRITICS = frozenset({
    "ConstraintCritic", "CostCritic", "GoalAngleCritic", "GoalCritic", "ObstaclesCritic", "PathAlignCritic",
    "PathFollowCritic", "PreferForwardCritic",
})  # fmt: skip


def goal_checker(kind: str) -> bool:
    """Whether a class of goal checker has the tolerances of the simple one."""
    return kind in {SIMPLE_GOAL, "nav2_controller::StoppedGoalChecker", "nav2_controller::PositionGoalChecker"}
