"""The navigation stack: layered costmap, global planner and local controller (model, section 9)."""

from qocjax.navigation.costmap import (
    Inflation,
    Layers,
    Obstacles,
    StaticLayer,
    check_free,
    costmap_layers,
    others,
    static_layer,
)
from qocjax.navigation.critics import (
    ConstraintCritic,
    CostCritic,
    Critic,
    GoalAngleCritic,
    GoalCritic,
    ObstaclesCritic,
    PreferForwardCritic,
)
from qocjax.navigation.distance import distance_to, squared_distance
from qocjax.navigation.field import cost_to_go
from qocjax.navigation.grid import Grid
from qocjax.navigation.local_path import MapCosts
from qocjax.navigation.map_files import read_map
from qocjax.navigation.maps import Disc, Rectangle, StaticMap, map_of_shapes
from qocjax.navigation.mppi import Rollouts, State, initial_state, predict, step, step_each
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.path_critics import PathAlignCritic, PathFollowCritic
from qocjax.navigation.planner import Path, follow, plan
from qocjax.navigation.snapshot import Snapshot, snapshot
from qocjax.navigation.stack import NavigationStack, open_floor
from qocjax.navigation.stack_parts import STACK_MPPI
from qocjax.navigation.wavefront import Planner

__all__ = [
    "STACK_MPPI",
    "ConstraintCritic",
    "CostCritic",
    "Critic",
    "Disc",
    "GoalAngleCritic",
    "GoalCritic",
    "Grid",
    "Inflation",
    "Layers",
    "MapCosts",
    "MppiConfig",
    "NavigationStack",
    "Obstacles",
    "ObstaclesCritic",
    "Path",
    "PathAlignCritic",
    "PathFollowCritic",
    "Planner",
    "PreferForwardCritic",
    "Rectangle",
    "Rollouts",
    "Snapshot",
    "State",
    "StaticLayer",
    "StaticMap",
    "check_free",
    "cost_to_go",
    "costmap_layers",
    "distance_to",
    "follow",
    "initial_state",
    "map_of_shapes",
    "open_floor",
    "others",
    "plan",
    "predict",
    "read_map",
    "snapshot",
    "squared_distance",
    "static_layer",
    "step",
    "step_each",
]
