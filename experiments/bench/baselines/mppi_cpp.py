"""One cycle of MPPI in C++ (mppi.cpp): vectors of rollouts in registers; compiled by g++ when first asked for."""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from experiments.bench.baselines.mppi_numpy import NumpyMppi
from experiments.bench.baselines.work import Unavailable
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.noise import ROUNDS

__all__ = ["CppMppi"]

SOURCE = Path(__file__).with_name("mppi.cpp")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-fPIC", "-shared", "-Wno-psabi")

_FLOAT, _FLOATS = ctypes.c_float, ctypes.POINTER(ctypes.c_float)
_COUNTS = ("samples", "steps", "rows", "cols", "points", "last", "cost_step", "align_step", "goal_on", "angle_on",
           "soft_on", "align_from", "follow_offset")  # fmt: skip
_NUMBERS = ("dt", "v_min", "v_max", "rise", "fall", "turn", "resolution", "spacing", "constraint", "forward",
            "critical", "near_collision", "collision", "cost", "to_goal", "angle", "align", "follow", "temperature",
            "occupancy")  # fmt: skip
_VECTORS = {"pose": 3, "goal": 3, "now": 2, "std": 2, "control": 2, "origin": 2}
_ARRAYS = ("mean_v", "mean_w", "cells", "path_x", "path_y", "clear",
           "drawn_v", "drawn_w", "total", "weight", "out_v", "out_w", "work")  # fmt: skip


class _Cycle(ctypes.Structure):
    """`struct Cycle` of the kernel."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _COUNTS),
        ("seed", ctypes.c_uint32 * 2),
        *((name, _FLOAT) for name in _NUMBERS),
        *((name, _FLOAT * count) for name, count in _VECTORS.items()),
        *((name, _FLOATS) for name in _ARRAYS),
    ]


class CppMppi(NumpyMppi):
    """The controller of one robot: what does not grow with K in NumPy, the rest in C++.

    Attributes:
        cost: [K] costs of the rollouts of the last cycle.
    """

    def __init__(self, config: MppiConfig, cells: np.ndarray, resolution: float, origin: tuple[float, float]) -> None:
        """Starts from rest.

        Args:
            config: With the default critics, in their order, all costs to the first power.
            cells: [rows, cols] costs.
            resolution: Of the cells (m).
            origin: Corner of the map (m).

        Raises:
            Unavailable: There is no g++, or it cannot compile the kernel.
            ValueError: K is no multiple of the lanes of a vector.
        """
        super().__init__(config, cells, resolution, origin)
        self._library = _compiled()
        lanes = self._library.lanes()
        if config.batch_size % lanes:
            raise ValueError(f"batch_size: got {config.batch_size}, the C++ baseline expects a multiple of {lanes}")

    def _prepared(self, pose: np.ndarray, path: np.ndarray, goal: np.ndarray, words: np.ndarray) -> _Cycle:
        """What the kernel is told of a cycle whose noise has these two random words as its key."""
        c = self.config
        local, last, remaining = self._local_path(pose, path)
        gap = np.hypot(*(pose[:2] - goal[:2]))
        visible = min(remaining, (len(local) - 1) * c.path_spacing)
        constraint, cells, to_goal, angle, align, follow, forward = c.critics
        self._arrays = {
            "mean_v": self.sequence[0], "mean_w": self.sequence[1], "cells": self.cells,
            "path_x": local[:, 0], "path_y": local[:, 1],
            "clear": self._cells_at(local[:, 0], local[:, 1]) < 253,
            "drawn_v": (c.time_steps, c.batch_size), "drawn_w": (c.time_steps, c.batch_size),
            "total": c.batch_size, "weight": c.batch_size, "out_v": c.time_steps, "out_w": c.time_steps,
            "work": (4, c.batch_size),
        }  # fmt: skip
        self._arrays = {name: _aligned(value) for name, value in self._arrays.items()}
        dt, limits = c.model_dt, (c.ax_max or np.inf, -(c.ax_min or -np.inf), c.az_max or np.inf)
        numbers: dict[str, Any] = dict(
            zip(("rise", "fall", "turn"), (each * dt for each in limits), strict=True),
            dt=dt, v_min=c.vx_min, v_max=c.vx_max, resolution=self.resolution, spacing=c.path_spacing,
            constraint=constraint.cost_weight * dt,
            forward=forward.cost_weight * dt * (gap >= forward.threshold_to_consider),
            critical=cells.critical_cost, near_collision=cells.near_collision_cost, collision=cells.collision_cost,
            cost=cells.cost_weight / 254 / -(-c.time_steps // cells.trajectory_point_step),
            to_goal=to_goal.cost_weight / c.time_steps, angle=angle.cost_weight / c.time_steps,
            align=align.cost_weight * (visible >= align.threshold_to_consider),
            follow=follow.cost_weight * (remaining >= follow.threshold_to_consider),
            temperature=c.temperature, occupancy=align.max_path_occupancy_ratio,
        )  # fmt: skip
        counts = dict(
            samples=c.batch_size, steps=c.time_steps, rows=self.cells.shape[0], cols=self.cells.shape[1],
            points=len(local), last=last, cost_step=cells.trajectory_point_step,
            align_step=align.trajectory_point_step, goal_on=remaining <= to_goal.threshold_to_consider,
            angle_on=gap < angle.threshold_to_consider, soft_on=gap >= cells.near_goal_distance,
            align_from=align.offset_from_furthest, follow_offset=follow.offset_from_furthest,
        )  # fmt: skip
        std = (c.vx_std, c.wz_std)
        vectors = {
            "pose": pose, "goal": goal, "now": self.sequence[:, 0], "std": std, "origin": self.origin,
            "control": [c.gamma / each**2 for each in std],
        }  # fmt: skip
        return _Cycle(
            **{name: int(value) for name, value in counts.items()},
            seed=(ctypes.c_uint32 * 2)(*(int(word) for word in words)),
            **{name: float(value) for name, value in numbers.items()},
            **{name: (_FLOAT * len(value))(*map(float, value)) for name, value in vectors.items()},
            **{name: value.ctypes.data_as(_FLOATS) for name, value in self._arrays.items()},
        )

    def loop(self) -> None:
        """All that grows with K, of the cycle prepared last: what is timed."""
        self._library.cycle(ctypes.byref(self._cycle))

    def step(self, pose: np.ndarray, path: np.ndarray, goal: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """One cycle, of a robot at the speed it was told, with two random words for its noise; the command."""
        self._cycle = self._prepared(pose, path, goal, noise)
        self.loop()
        self.cost = self._arrays["total"]
        return self._sent(np.stack([self._arrays["out_v"], self._arrays["out_w"]]))


def _aligned(value: Any) -> np.ndarray:
    """A copy in float32, or zeros of a shape, that begins at a multiple of 64 bytes."""
    shape = value.shape if isinstance(value, np.ndarray) else value
    size = int(np.prod(shape))
    raw = np.zeros(size + 16, np.float32)
    begin = -raw.ctypes.data % 64 // 4
    array = raw[begin : begin + size].reshape(shape)
    if isinstance(value, np.ndarray):
        array[:] = value
    return array


@functools.cache
def _compiled() -> ctypes.CDLL:
    """The kernel, compiled for this processor."""
    compiler = shutil.which("g++")
    if compiler is None:
        raise Unavailable("the C++ baseline needs g++ on the PATH")
    with tempfile.TemporaryDirectory(prefix="qocjax-bench-") as folder:
        library = Path(folder) / "mppi.so"
        command = [compiler, *FLAGS, f"-DROUNDS={ROUNDS}", str(SOURCE), "-o", str(library)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Unavailable(f"g++ cannot compile the C++ baseline ({' '.join(command)}):\n{done.stderr}")
        return ctypes.CDLL(str(library))  # stays loaded when its file is gone
