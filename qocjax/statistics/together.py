"""Many differences looked at together: which of them are told from 0, whichever of them one looks at."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from qocjax._lazy import special

__all__ = ["told_apart"]


def told_apart(means: ArrayLike, errors: ArrayLike, observations: int, confidence: float = 0.95) -> np.ndarray:
    """The sign of each mean that is told from 0, and 0 for the others, all at once (Holm, 1979).

    With this confidence not one sign is due to chance, however the differences hang together. So one may look for the
    largest, or for the deadline at which something is told: what is found there stands.

    Args:
        means: [K] differences.
        errors: [K] their standard errors; without any a mean is exact.
        observations: What each is made of: Student's law has one less.
        confidence: Of all together.

    Returns:
        [K] 1, -1 or 0.
    """
    found, spread = np.asarray(means, np.float64), np.asarray(errors, np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(found == 0.0, 0.0, np.abs(found) / spread)
    chance = 2.0 * special().stdtr(max(observations - 1, 1), -ratio)
    order = np.argsort(chance, kind="stable")
    allowed = (1.0 - confidence) / np.arange(found.size, 0, -1)
    told = np.zeros(found.size, bool)
    told[order] = np.logical_and.accumulate(chance[order] <= allowed)
    return np.where(told, np.sign(found), 0.0).astype(int)
