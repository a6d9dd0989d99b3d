"""The closed loop as a scalar loop per run, compiled by Numba, parallel over runs."""

from __future__ import annotations

import numpy as np

from experiments.bench.baselines.work import DESIGN, Unavailable, Work, reference_path

__all__ = ["evaluate"]


def evaluate(work: Work) -> np.ndarray:
    """AUC of each lane and robot, [L, N] float32.

    Raises:
        Unavailable: Numba is not installed.
    """
    try:
        from experiments.bench.baselines.numba_kernel import run_lanes
    except ImportError as error:
        raise Unavailable(f"the Numba baseline needs numba: {error}") from error
    design = np.stack([getattr(work, name) for name in DESIGN], axis=-1)
    goal, weights = np.asarray(work.goal, np.float32), np.asarray(work.weights, np.float32)
    shared = (work.loop_times, work.start, reference_path(work), goal, weights, np.float32(work.tau))
    return run_lanes(design, work.deadline, *work.change, work.seed, *shared)
