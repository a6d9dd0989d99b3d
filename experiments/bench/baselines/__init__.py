"""Other ways to run the closed loop, for the benchmark suite to compare with.

Every module here has one function, `evaluate(work) -> auc`, with the same meaning: run each lane of a `Work` to the
horizon and return the AUC of its robots, [L, N] float32 (model, sections 2 to 5; actuation `deadline`, hold ZOH,
reference `nominal`, integral by the trapezoid at the sampling instants). None of them uses the package.

- `numpy_loop`: a Python loop over ticks, NumPy over the lanes.
- `vmap_scan`: one run as a `lax.scan`, then `jax.vmap` and `jax.jit`.
- `numba_loop`: a scalar loop per run, `prange` over the runs.
- `cpp_kernel`: GCC vector extensions and OpenMP, compiled when first called.
- `cpp_metrics`: the same with all metrics, and the integral corrected as that of qocjax.

The last three raise `Unavailable` where their compiler is missing.
"""

from __future__ import annotations

from experiments.bench.baselines.work import Unavailable, Work, make_work, reference_path, reference_share

__all__ = ["Unavailable", "Work", "make_work", "reference_path", "reference_share"]
