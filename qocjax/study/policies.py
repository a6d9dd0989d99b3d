"""The three policies: which point of a sweep each one picks (model, section 6)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

__all__ = ["MIN_RELIABILITY", "POLICIES", "NoDesignError", "co_design", "max_rel", "min_delay"]

# MinDelay takes the smallest deadline with at least this loop-completion probability: at F = 0 nothing can be tuned.
MIN_RELIABILITY = 0.01


class NoDesignError(ValueError):
    """Nothing is left to choose from: every score is NaN."""


Policy = Callable[[np.ndarray, np.ndarray, float], tuple[int, int]]


def co_design(qoc: np.ndarray, reliability: np.ndarray, min_reliability: float = MIN_RELIABILITY) -> tuple[int, int]:
    """Best value and deadline together.

    Args:
        qoc: [V, D] QoC over values and ascending deadlines; NaN is never picked.
        reliability: [V, D] or [D] F(Delta); not read by this policy.
        min_reliability: Not read by this policy.

    Returns:
        Indices of value and deadline.

    Raises:
        NoDesignError: Every score is NaN.
    """
    value, deadline = np.unravel_index(_best(qoc), qoc.shape)
    return int(value), int(deadline)


def min_delay(qoc: np.ndarray, reliability: np.ndarray, min_reliability: float = MIN_RELIABILITY) -> tuple[int, int]:
    """Best value at the smallest deadline at which some value has enough reliability, of those that have.

    A reliability of 0 asks for the literal smallest deadline.

    Raises:
        ValueError: No deadline of the axis is reliable enough.
        NoDesignError: Every score at that deadline is NaN.
    """
    enough = np.broadcast_to(reliability >= min_reliability, qoc.shape)
    if not enough.any():
        raise ValueError(
            f"deadline: got F(deadline) <= {reliability.max():.3g} on the whole axis, expected one with at least "
            f"{min_reliability:g} for MinDelay (a larger deadline, or min_reliability=0)"
        )
    first = int(np.argmax(enough.any(axis=0)))
    return _best(np.where(enough[:, first], qoc[:, first], np.nan)), first


def max_rel(qoc: np.ndarray, reliability: np.ndarray, min_reliability: float = MIN_RELIABILITY) -> tuple[int, int]:
    """Best value at the largest deadline, where the most loops complete.

    Raises:
        NoDesignError: Every score there is NaN.
    """
    return _best(qoc[:, -1]), qoc.shape[1] - 1


def _best(scores: np.ndarray) -> int:
    if np.isnan(scores).all():
        raise NoDesignError("qoc: got NaN for every design, expected one that neither diverged nor failed")
    return int(np.nanargmax(scores))


POLICIES: dict[str, Policy] = {"Co-design": co_design, "MinDelay": min_delay, "MaxRel": max_rel}
