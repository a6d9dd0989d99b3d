"""The layered costmap that planner and local controller share: c = c_stat + c_obs + c_infl (model, section 9).

Costs are Nav2's, whole numbers from 0 (free) to 252, 253 (within the robot's inscribed radius of an obstacle), 254 (an
obstacle) and 255 (unknown). All simulations of a batch, and all robots, share the static map; each robot has a map of
its own only in that it is no obstacle to itself.

Shapes: batch axes `*B` first, then the cells, as images are kept; M discs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.cost_values import FREE, INSCRIBED, LETHAL, UNKNOWN
from qocjax.navigation.grid import Grid
from qocjax.navigation.maps import StaticMap
from qocjax.scenario import _pytree

__all__ = ["Inflation", "Layers", "Obstacles", "StaticLayer", "check_free", "costmap_layers", "influence", "layers_at",
           "others", "static_layer"]  # fmt: skip

_DEAREST = INSCRIBED - 1  # of the open cells
_ROUNDING = 1e-4  # of a cell, in comparisons of distances


@_pytree
@dataclass(frozen=True)
class Inflation:
    """How costs fall off around obstacles; names and defaults of Nav2's inflation layer where it has them.

    Values are numbers, or arrays [*B] of one per map.

    Attributes:
        robot_radius: Of the robot that the map is for, its inscribed radius (m).
        inflation_radius: Distance up to which an obstacle costs anything (m), rounded up to whole cells as in Nav2.
        cost_scaling_factor: Rate of the exponential decay (1/m).
        localisation_sigma: Standard deviation of the robot's estimated position (m).
        sigma_factor: How many of these standard deviations are kept clear.
    """

    robot_radius: ArrayLike = 0.105
    inflation_radius: ArrayLike = 0.55
    cost_scaling_factor: ArrayLike = 10.0
    localisation_sigma: ArrayLike = 0.0
    sigma_factor: ArrayLike = 2.0

    def __post_init__(self) -> None:
        for name in ("robot_radius", "inflation_radius", "cost_scaling_factor", "localisation_sigma", "sigma_factor"):
            object.__setattr__(self, name, _checks.bounded(name, getattr(self, name), least=0))


class StaticLayer(NamedTuple):
    """The static map, and how far each cell is from its obstacles; made once."""

    cost: Array  # [rows, cols]
    distance: Array  # [rows, cols] m, infinite without an obstacle


class Obstacles(NamedTuple):
    """Discs where other robots were last seen. Each field is [*B, M], or a number for all."""

    x: Array  # m
    y: Array  # m
    age: ArrayLike = 0.0  # of these positions, s
    speed: ArrayLike = 0.0  # at which they may have moved since, m/s
    radius: ArrayLike = 0.105  # m


class Layers(NamedTuple):
    """The layers of a costmap, each [*B, rows, cols] or, for the static one, [rows, cols]."""

    static: Array  # c_stat
    obstacles: Array  # c_obs
    inflation: Array  # c_infl

    def total(self) -> Array:
        """The sum c = c_stat + c_obs + c_infl, in Nav2's scale.

        What one layer closes is closed (253 or 254), and open cells stay open: their sum ends at 252. On a map of
        obstacles and free cells no two layers have a cost in the same open cell, and the sum is Nav2's maximum of
        layers. An unknown cell stays unknown unless it is closed, as in Nav2.
        """
        unknown = self.static == UNKNOWN
        known = jnp.where(unknown, FREE, self.static)
        known, unknown = (_to_rank(each, self.inflation.ndim) for each in (known, unknown))
        largest = jnp.maximum(jnp.maximum(known, self.obstacles), self.inflation)
        cost = jnp.minimum(known + self.obstacles + self.inflation, _DEAREST)
        return jnp.where(largest >= INSCRIBED, largest, jnp.where(unknown, float(UNKNOWN), cost))


def static_layer(static_map: StaticMap, track_unknown_space: bool = False) -> StaticLayer:
    """The static layer of a map, with the distance transform that inflation needs.

    Args:
        static_map: The map.
        track_unknown_space: Nav2's parameter: whether unknown cells stay 255; else they are free.
    """
    cost, dtype = static_map.cost, jnp.result_type(float)
    known = cost if track_unknown_space else np.where(cost == UNKNOWN, FREE, cost)
    squared = _squared_distance(cost == LETHAL)
    distance = np.sqrt(squared.astype(dtype)) * dtype.type(static_map.grid.resolution)
    return StaticLayer(*cast(tuple[Array, Array], (known.astype(dtype), distance)))


def _squared_distance(occupied: np.ndarray) -> np.ndarray:
    """Squared distance, in cells, of each cell from the nearest occupied one; infinite where there is none.

    Of a map, which is known before anything is traced, so that it needs no program. In whole numbers, so exact.
    """
    if not occupied.any():
        return np.full(occupied.shape, np.inf)
    from scipy.ndimage import distance_transform_edt  # takes long, and a configuration needs none

    rows, cols = occupied.shape
    nearest = distance_transform_edt(~occupied, return_distances=False, return_indices=True)
    if rows**2 + cols**2 > np.iinfo(nearest.dtype).max:
        nearest = nearest.astype(np.int64)
    for away, index in zip(nearest, np.ogrid[:rows, :cols], strict=True):
        away -= index.astype(away.dtype)
        away *= away
    nearest[0] += nearest[1]
    return nearest[0]


def others(values: Array) -> Array:
    """For each robot the values of the others: [N, *B] becomes [N, *B, N - 1]."""
    count = values.shape[0]
    index = np.array([[j for j in range(count) if j != i] for i in range(count)], int).reshape(count, count - 1)
    return jnp.moveaxis(values[index], 1, -1)


def costmap_layers(grid: Grid, static: StaticLayer, obstacles: Obstacles | None, inflation: Inflation) -> Layers:
    """The layers of the costmaps of a batch.

    Nav2's inflation layer sets a cell at distance d from the nearest obstacle to 253 for d <= robot_radius and, up to
    the inflation radius, to 252 exp(-cost_scaling_factor (d - robot_radius)), cut to a whole number (computeCost in
    inflation_layer.hpp). Here d is first shortened by what is not known of where the obstacle is, which shifts the
    closed zone and the decay outwards as they are:

        w = sigma_factor localisation_sigma                   for the static map,
        w = sigma_factor localisation_sigma + age speed       for a robot that was seen `age` ago.

    A cell is lethal only where an obstacle was seen. Distances from the static map are exact between centres of cells,
    as in Nav2; those from a disc are from its edge, in closed form, since each disc has its own w.

    Args:
        grid: Where the cells lie.
        static: From `static_layer`.
        obstacles: The other robots, from `others`; None without any, for one map.
        inflation: Parameters.
    """
    return layers_at(grid.centres(), grid.resolution, static, obstacles, inflation)


def layers_at(
    centres: tuple[ArrayLike, ArrayLike],
    resolution: float,
    static: StaticLayer,
    obstacles: Obstacles | None,
    inflation: Inflation,
) -> Layers:
    """`costmap_layers` of the cells whose centres are at x [1, cols] and y [rows, 1] (m)."""
    margin = _per_map(inflation.sigma_factor) * _per_map(inflation.localisation_sigma)
    known = _to_rank(static.distance, 2 if obstacles is None else obstacles.x.ndim + 1)
    if obstacles is None or obstacles.x.shape[-1] == 0:
        batch = () if obstacles is None else obstacles.x.shape[:-1]
        seen = jnp.zeros((*batch, *static.cost.shape), bool)
        clearance = jnp.broadcast_to(known, seen.shape) - margin
    else:
        distance, moved = _from_discs(centres, obstacles)
        seen = jnp.any(distance <= 0, axis=-3)
        clearance = jnp.minimum(known, jnp.min(distance - moved, axis=-3)) - margin
    lethal = seen | _to_rank(static.cost == LETHAL, seen.ndim)
    inflated = jnp.where(lethal, 0.0, _inflated(clearance, inflation, resolution))
    return Layers(static.cost, jnp.where(seen, float(LETHAL), 0.0), inflated)


def _from_discs(centres: tuple[ArrayLike, ArrayLike], discs: Obstacles) -> tuple[Array, Array]:
    """Distance of each cell from each disc [*B, M, rows, cols], and how far each may have moved [*B, M, 1, 1] (m)."""
    shape = discs.x.shape
    speed, age = (jnp.broadcast_to(jnp.asarray(v, float), shape) for v in (discs.speed, discs.age))
    moved = jnp.where(speed > 0, age * speed, 0.0)  # also where the age is infinite
    cell_x, cell_y = (_to_rank(jnp.asarray(v, float), len(shape) + 2) for v in centres)
    x, y, radius = (jnp.broadcast_to(jnp.asarray(v, float), shape)[..., None, None] for v in discs[:2] + discs[4:])
    from_centre = jnp.sqrt((cell_x - x) ** 2 + (cell_y - y) ** 2)
    return jnp.maximum(from_centre - radius, 0.0), moved[..., None, None]


def _inflated(clearance: Array, inflation: Inflation, resolution: float) -> Array:
    radius, rate = _per_map(inflation.robot_radius), _per_map(inflation.cost_scaling_factor)
    slack = _ROUNDING * resolution
    reach = jnp.ceil(_per_map(inflation.inflation_radius) / resolution - _ROUNDING) * resolution
    decayed = jnp.floor(_DEAREST * jnp.exp(-rate * jnp.maximum(clearance - radius, 0.0)))
    around = jnp.where(clearance <= radius + slack, float(INSCRIBED), decayed)
    return jnp.where(clearance <= jnp.maximum(reach, radius) + slack, around, 0.0)


def influence(inflation: Inflation, resolution: float, radius: float, most_moved: float) -> int:
    """Cells in each direction from that of a disc's centre beyond which it costs nothing.

    Args:
        inflation: Parameters, each a number.
        resolution: Side of a cell (m).
        radius: Of the disc (m).
        most_moved: How far it may have moved since it was seen (m).
    """
    own, around, _, sigma, factor = (float(np.asarray(each)) for each in vars(inflation).values())
    return math.ceil((max(around, own) + factor * sigma + radius + most_moved) / resolution) + 2


def check_free(name: str, points: ArrayLike, grid: Grid, cost: ArrayLike) -> None:
    """Checks that a robot's centre may be at each point.

    Args:
        name: What the points are, for the message: "start", "goal".
        points: [..., 2] m.
        grid: Where the cells lie.
        cost: [rows, cols].

    Raises:
        ValueError: A point lies beside the map or in a closed cell; the message says which.
    """
    costs = np.asarray(cost)
    for index, (x, y) in enumerate(np.reshape(np.asarray(points, float), (-1, 2))):
        row, col = np.floor((y - grid.origin[1]) / grid.resolution), np.floor((x - grid.origin[0]) / grid.resolution)
        where = f"{name}: got ({x:g}, {y:g}) for robot {index}"
        if not (0 <= row < grid.shape[0] and 0 <= col < grid.shape[1]):
            low_x, high_x, low_y, high_y = grid.extent
            reach = f"x from {low_x:g} to {high_x:g} and y from {low_y:g} to {high_y:g}"
            raise ValueError(f"{where}, which is beside the map, expected {reach}")
        found = costs[int(row), int(col)]
        if INSCRIBED <= found < UNKNOWN:
            what = "in an obstacle" if found >= LETHAL else "nearer to an obstacle than the robot's radius"
            raise ValueError(f"{where}, which is {what} (cost {found:g}), expected a free cell")


def _per_map(value: Any) -> Array:
    """A number as it is, [*B] as [*B, 1, 1]."""
    array = jnp.asarray(value, float)
    return array[..., None, None] if array.ndim else array


def _to_rank(array: Array, rank: int) -> Array:
    return jax.lax.expand_dims(array, range(rank - array.ndim))
