"""What one robot of the navigation stack had before it at one instant of a run: for figures."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np

from qocjax import _checks
from qocjax._kept import called
from qocjax.navigation.costmap import Layers
from qocjax.navigation.cycle import View, look
from qocjax.navigation.grid import Grid
from qocjax.navigation.mppi import Rollouts
from qocjax.navigation.stack import NavigationStack

__all__ = ["Snapshot", "snapshot"]


def _look(view: View, arrays: Any, stack: NavigationStack) -> tuple[Layers, jax.Array, Rollouts]:
    layers, rollouts = look(stack.holding(arrays), view)
    return layers, layers.total(), rollouts


class Snapshot(NamedTuple):
    """A cycle, as NumPy arrays."""

    grid: Grid
    layers: Layers  # each [rows, cols], 0 to 255
    total: np.ndarray  # [rows, cols] their sum
    path: np.ndarray  # [L, 2] global path, the last point repeated (m)
    rollouts: Rollouts  # K rollouts of H points
    begin: np.ndarray  # [3] where the rollouts begin (m, m, rad)
    obstacles: np.ndarray  # [N - 1, 2] where the other robots were last known (m)
    widening: np.ndarray  # [N - 1] by which the inflation around each is widened (m)
    goal: np.ndarray  # [2] m


def snapshot(stack: NavigationStack, run: Any, tick: int, robot: int) -> Snapshot:
    """Computes a cycle of a run again, with all of its rollouts.

    Args:
        stack: That the run was simulated with.
        run: From `simulate` or `replay`.
        tick: Sampling instant, from 0.
        robot: From 0.

    Raises:
        ValueError: No such instant or robot, or the run is not of the stack.
    """
    if not isinstance(run.view, View):
        raise ValueError("run: got one of another controller, expected one of the navigation stack")
    ticks, robots = np.shape(run.command)[:2]
    for name, value, count in (("tick", tick, ticks), ("robot", robot, robots)):
        if not _checks.count(name, value, least=0) < count:
            raise ValueError(f"{name}: got {value}, expected below {count}")
    view: View = jax.tree.map(lambda a: a[tick, robot], run.view)
    layers, total, rollouts = jax.tree.map(np.asarray, called(_look, (view, stack.held()), (stack,)))
    discs = view.obstacles
    return Snapshot(
        stack.static_map.grid, layers, total, np.asarray(view.path), rollouts, np.asarray(view.begin),
        np.stack([discs.x, discs.y], axis=-1), np.asarray(discs.speed * discs.age), np.asarray(view.goal),
    )  # fmt: skip
