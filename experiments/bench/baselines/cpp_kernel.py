"""The closed loop in C++ (kernel.cpp): vectors of lanes, OpenMP over vectors; compiled by g++ when first called."""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from experiments.bench.baselines.work import DESIGN, Unavailable, Work, reference_share

__all__ = ["TOTALS", "evaluate", "run"]

SOURCE = Path(__file__).with_name("kernel.cpp")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-fPIC", "-shared", "-Wno-psabi")
# What the kernel adds up beside the AUC, in its order.
TOTALS = ("path_length", "effort", "last_away", "age_sum", "age_peak", "completed")
# The series for an arc holds up to this turn per period (rad).
MAX_TURN = 0.5

_FLOATS, _INTS = ctypes.POINTER(ctypes.c_float), ctypes.POINTER(ctypes.c_int)
_ARRAYS: dict[str, Any] = {
    "design": _FLOATS, "deadline": _FLOATS, "rest": _FLOATS, "lag": _INTS, "seed": _INTS, "loop_times": _FLOATS,
    "start": _FLOATS, "offset": _FLOATS, "share": _FLOATS, "auc": _FLOATS, "totals": _FLOATS, "closest": _FLOATS,
}  # fmt: skip


class _Work(ctypes.Structure):
    """`struct Work` of the kernel."""

    _fields_ = [
        ("vectors", ctypes.c_int),
        ("ticks", ctypes.c_int),
        ("tau", ctypes.c_float),
        ("weights", ctypes.c_float * 2),
        *_ARRAYS.items(),
    ]


def evaluate(work: Work) -> np.ndarray:
    """AUC of each lane and robot, [L, N] float32; see `run`."""
    return run(work)["auc"]


def run(work: Work, metrics: bool = False) -> dict[str, np.ndarray]:
    """What a build of the kernel computes, float32.

    The lanes of a vector share their deadline: one with fewer lanes than a vector has costs as much as a full vector.

    Args:
        work: The runs.
        metrics: Whether that is `TOTALS` too, in periods where they are times, and the smallest squared distance.

    Returns:
        `auc` and `TOTALS`, each [L, N], and `closest` [L] (m²).

    Raises:
        Unavailable: There is no g++, or it cannot compile the kernel.
        ValueError: A robot may turn by more than MAX_TURN in a period.
    """
    largest = float(work.omega_max.max()) * work.tau
    if largest > MAX_TURN:
        raise ValueError(f"omega_max * tau: got {largest:.3g} rad, the C++ baseline expects at most {MAX_TURN}")
    library = _compiled(work.num_robots, metrics)
    lane = _vectors(work, library.lanes())  # [V, W]
    lag, rest = work.change
    origin = np.array([*work.goal, 0], np.float32)
    arrays = {
        "design": np.stack([getattr(work, name)[lane] for name in DESIGN], axis=1),
        "deadline": work.deadline[lane[:, 0]],
        "rest": rest[lane[:, 0]],
        "lag": lag[lane[:, 0]],
        "seed": work.seed[lane],
        "loop_times": work.loop_times,
        "start": work.start - origin,
        "offset": (work.start[..., :2].mean(axis=1, dtype=np.float64) - work.goal).astype(np.float32),
        "share": reference_share(work),
        "auc": np.empty((len(lane), work.num_robots, lane.shape[1]), np.float32),
        "totals": np.empty((len(lane), work.num_robots, len(TOTALS), lane.shape[1]) if metrics else 0, np.float32),
        "closest": np.empty(lane.shape if metrics else 0, np.float32),
    }
    arrays = {name: np.ascontiguousarray(a) for name, a in arrays.items()}
    pointers = {name: arrays[name].ctypes.data_as(kind) for name, kind in _ARRAYS.items()}
    weights = (ctypes.c_float * 2)(*work.weights)
    library.evaluate(ctypes.byref(_Work(len(lane), work.num_ticks, work.tau, weights, **pointers)))
    found = {"auc": arrays["auc"].swapaxes(1, 2)}
    if metrics:
        found |= {name: arrays["totals"][:, :, k].swapaxes(1, 2) for k, name in enumerate(TOTALS)}
        found["closest"] = arrays["closest"]
    return {name: _by_lane(values, lane, work.num_lanes) for name, values in found.items()}


def _by_lane(values: np.ndarray, lane: np.ndarray, lanes: int) -> np.ndarray:
    """[V, W, ...] by vector, as [L, ...]."""
    found = np.empty((lanes, *values.shape[2:]), values.dtype)
    found[lane] = values
    return found


def _vectors(work: Work, width: int) -> np.ndarray:
    """Lanes of each vector, [V, W]: of one deadline, filled up by repeating a lane; vectors of like seeds adjacent."""
    order = np.argsort(work.deadline, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(work.deadline[order])) + 1)
    padded = [np.pad(group, (0, -len(group) % width), mode="edge") for group in groups]
    lane = np.concatenate(padded).reshape(-1, width)
    return lane[np.lexsort(work.seed[lane].T)]


@functools.cache
def _compiled(num_robots: int, metrics: bool) -> ctypes.CDLL:
    """The kernel for that many robots, compiled for this processor."""
    compiler = shutil.which("g++")
    if compiler is None:
        raise Unavailable("the C++ baseline needs g++ on the PATH")
    with tempfile.TemporaryDirectory(prefix="qocjax-bench-") as folder:
        library = Path(folder) / "kernel.so"
        command = [
            compiler,
            *FLAGS,
            f"-DROBOTS={num_robots}",
            f"-DMETRICS={int(metrics)}",
            str(SOURCE),
            "-o",
            str(library),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Unavailable(f"g++ cannot compile the C++ baseline ({' '.join(command)}):\n{done.stderr}")
        return ctypes.CDLL(str(library))  # stays loaded when its file is gone
