"""MPPI in NumPy, whole arrays [H, K] at a time: the default critics of `qocjax.navigation`, for comparison."""

from __future__ import annotations

import numpy as np

from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.smoothing import HISTORY

__all__ = ["NumpyMppi"]

COLLISION = 253.0


class NumpyMppi:
    """The controller of one robot.

    Attributes:
        cost: [K] costs of the rollouts of the last cycle.
    """

    def __init__(self, config: MppiConfig, cells: np.ndarray, resolution: float, origin: tuple[float, float]) -> None:
        """Starts from rest.

        Args:
            config: With the default critics, in their order.
            cells: [rows, cols] costs.
            resolution: Of the cells (m).
            origin: Corner of the map (m).
        """
        self.config, self.cells, self.resolution, self.origin = config, cells.astype(np.float32), resolution, origin
        self.sequence = np.zeros((2, config.time_steps), np.float32)
        self.past = np.zeros((2, HISTORY), np.float32)
        self.cost = np.zeros(config.batch_size, np.float32)
        offsets = np.arange(-HISTORY, HISTORY + 1)
        self.kernel = np.linalg.pinv(np.vander(offsets, config.sgf_order + 1, increasing=True))[0].astype(np.float32)

    def step(self, pose: np.ndarray, path: np.ndarray, goal: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """One cycle, of a robot at the speed it was told, with noise [2, H, K]; returns the command (m/s, rad/s)."""
        c = self.config
        std = np.array([c.vx_std, c.wz_std], np.float32)[:, None, None]
        sampled = self.sequence[..., None] + std * noise
        wanted = np.concatenate([np.broadcast_to(self.sequence[:, :1, None], sampled[:, :1].shape), sampled[:, :-1]], 1)
        speeds = self._driven(wanted)
        x, y, heading = self._move(pose, speeds)
        distance = np.sum(np.abs(speeds[0, 1:]), axis=0) * np.float32(c.model_dt)
        local, last, remaining = self._local_path(pose, path)
        self.cost = np.zeros(c.batch_size, np.float32)
        for mean, sample, sigma in zip(self.sequence, sampled, std[:, 0, 0], strict=True):
            self.cost += np.float32(c.gamma / sigma**2) * (mean @ sample - mean @ mean)
        self.cost += self._own_critics(pose, goal, x, y, heading, speeds[0], remaining)
        self.cost += self._path_critics(x, y, distance, local, last, remaining)
        weight = np.exp((self.cost.min() - self.cost) / np.float32(c.temperature))
        weight /= weight.sum()
        mean = sampled @ weight
        return self._sent(mean)

    def _sent(self, mean: np.ndarray) -> np.ndarray:
        """Smooths, caps and shifts the averaged sequence [2, H]; returns the command."""
        c = self.config
        low, high = np.array([c.vx_min, -c.wz_max], np.float32), np.array([c.vx_max, c.wz_max], np.float32)
        padded = np.concatenate([self.past, mean, np.repeat(mean[:, -1:], HISTORY, axis=1)], axis=1)
        smooth = np.stack([np.convolve(each, self.kernel, "valid") for each in padded])
        smooth[:, -1] = mean[:, -1]
        self.past = np.concatenate([self.past[:, 1:], smooth[:, 1:2]], axis=1)
        capped = np.clip(smooth, low[:, None], high[:, None])
        capped[:, 0] = self.sequence[:, 0]
        feasible = self._driven(capped[..., None])[..., 0]
        self.sequence = np.concatenate([feasible[:, 1:], feasible[:, -1:]], axis=1)
        return self.sequence[:, 0]

    def _driven(self, wanted: np.ndarray) -> np.ndarray:
        """Speeds [2, H, K] on the way through those wanted, from the first of them, within the accelerations."""
        c, speeds = self.config, wanted.copy()
        rise, fall, turn = (np.float32(each * c.model_dt) for each in (c.ax_max, -c.ax_min, c.az_max))
        for i in range(1, speeds.shape[1]):
            v, w = speeds[:, i - 1]
            speeds[0, i] = np.clip(speeds[0, i], v - np.where(v > 0, fall, rise), v + np.where(v > 0, rise, fall))
            speeds[1, i] = np.clip(speeds[1, i], w - turn, w + turn)
        return speeds

    def _move(self, pose: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points [H, K] of exact arcs: chords in the direction of half the turn."""
        dt = np.float32(self.config.model_dt)
        turn = speeds[1] * dt
        heading = np.cumsum(turn, axis=0) + pose[2]
        middle = heading - 0.5 * turn
        chord = speeds[0] * dt * np.sinc(turn / np.float32(2 * np.pi))
        return (
            np.cumsum(chord * np.cos(middle), axis=0) + pose[0],
            np.cumsum(chord * np.sin(middle), axis=0) + pose[1],
            heading,
        )

    def _cells_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        rows, cols = self.cells.shape
        column = np.floor((x - np.float32(self.origin[0])) / np.float32(self.resolution)).astype(np.int32)
        row = np.floor((y - np.float32(self.origin[1])) / np.float32(self.resolution)).astype(np.int32)
        inside = (column >= 0) & (column < cols) & (row >= 0) & (row < rows)
        return np.where(inside, self.cells.ravel()[np.where(inside, row * cols + column, 0)], np.float32(255.0))

    def _own_critics(
        self,
        pose: np.ndarray,
        goal: np.ndarray,
        x: np.ndarray,
        y: np.ndarray,
        heading: np.ndarray,
        vx: np.ndarray,
        remaining: float,
    ) -> np.ndarray:
        """Constraint, cost, goal, goal angle and prefer-forward critics; those that are off cost no time."""
        c = self.config
        constraint, cells, to_goal, angle, _, _, forward = c.critics
        gap = np.hypot(*(pose[:2] - goal[:2]))
        excess = np.maximum(vx - c.vx_max, 0) + np.maximum(c.vx_min - vx, 0)
        cost = constraint.cost_weight * np.sum(excess, axis=0) * np.float32(c.model_dt)
        every = cells.trajectory_point_step
        found = self._cells_at(x[::every], y[::every])
        soft = found if gap >= cells.near_goal_distance else np.zeros_like(found)
        total = np.sum(np.where(found >= cells.near_collision_cost, np.float32(cells.critical_cost), soft), axis=0)
        total = np.where(np.any(found >= COLLISION, axis=0), np.float32(cells.collision_cost), total)
        cost += np.float32(cells.cost_weight / 254 / len(found)) * total
        if remaining <= to_goal.threshold_to_consider:
            cost += np.float32(to_goal.cost_weight) * np.mean(np.hypot(x - goal[0], y - goal[1]), axis=0)
        if gap < angle.threshold_to_consider:
            turn = heading - goal[2]
            turn -= np.float32(2 * np.pi) * np.round(turn / np.float32(2 * np.pi))
            cost += np.float32(angle.cost_weight) * np.mean(np.abs(turn), axis=0)
        if gap >= forward.threshold_to_consider:
            cost += np.float32(forward.cost_weight * c.model_dt) * np.sum(np.maximum(-vx, 0), axis=0)
        return cost

    def _local_path(self, pose: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, int, float]:
        """Points [M, 2] along the path from the one nearest to the robot on, the index of its end, and what is left."""
        c, leaps = self.config, np.diff(path, axis=0)
        squared = np.sum(leaps**2, axis=1)
        length, safe = np.sqrt(squared), np.where(squared > 0, squared, 1.0)
        share = np.clip(np.sum((pose[:2] - path[:-1]) * leaps, axis=1) / safe, 0.0, 1.0)
        nearest = np.argmin(np.sum((path[:-1] + share[:, None] * leaps - pose[:2]) ** 2, axis=1))
        reached = np.append(0.0, np.cumsum(length))
        begin = reached[nearest] + share[nearest] * length[nearest]
        begin = min(np.round(begin / c.path_spacing) * c.path_spacing, reached[-1])
        count = round(c.prune_distance / c.path_spacing) + 1
        at = np.minimum(begin + c.path_spacing * np.arange(count), reached[-1])
        local = np.stack([np.interp(at, reached, path[:, i]) for i in (0, 1)], axis=1).astype(np.float32)
        remaining = reached[-1] - begin
        return local, min(int(np.ceil(remaining / c.path_spacing)), count - 1), float(remaining)

    def _path_critics(
        self, x: np.ndarray, y: np.ndarray, distance: np.ndarray, local: np.ndarray, last: int, remaining: float
    ) -> np.ndarray:
        """Path align and path follow critics."""
        c, align, follow = self.config, self.config.critics[4], self.config.critics[5]
        clear = self._cells_at(local[:, 0], local[:, 1]) < COLLISION
        gaps = (x[-1] - local[:, :1]) ** 2 + (y[-1] - local[:, 1:]) ** 2
        index = np.arange(len(local))[:, None]
        furthest = int(np.argmin(np.where(index <= np.ceil(distance / c.path_spacing), gaps, np.inf), axis=0).max())
        cost = np.zeros(c.batch_size, np.float32)
        blocked, visible = np.sum(~clear[:furthest]), min(remaining, (len(local) - 1) * c.path_spacing)
        free = blocked <= 2 or blocked <= align.max_path_occupancy_ratio * furthest
        if free and furthest >= align.offset_from_furthest and visible >= align.threshold_to_consider:
            every = align.trajectory_point_step
            along = np.cumsum(np.hypot(np.diff(x[::every], axis=0), np.diff(y[::every], axis=0)), axis=0)
            index = np.minimum((along / np.float32(c.path_spacing) + np.float32(0.5)).astype(np.int32), last)
            gap = np.hypot(local[index, 0] - x[every::every], local[index, 1] - y[every::every])
            used = clear[index]
            weight = np.float32(align.cost_weight)
            cost += weight * np.sum(gap * used, axis=0) / np.maximum(np.sum(used, axis=0), 1)
        if remaining >= follow.threshold_to_consider:
            ahead = [i for i in range(furthest + follow.offset_from_furthest, last) if clear[i]]
            target = local[ahead[0] if ahead else last]
            cost += np.float32(follow.cost_weight) * np.hypot(x[-1] - target[0], y[-1] - target[1])
        return cost
