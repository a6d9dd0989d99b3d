"""When a loop counts as complete.

A loop completes if T_net <= deadline (model, section 4; paper, Eq. 12). Times are rounded, to float32 above all, and a
loop measured as 100 ms must complete by a deadline of 100 ms. So the deadline has a small relative allowance, and every
comparison of a loop time with a deadline goes through this module.
"""

from __future__ import annotations

from typing import Any

__all__ = ["ALLOWANCE", "completes", "latest"]

# Above the rounding of a sum of three float32 delays (2e-7), far below any effect on control.
ALLOWANCE = 1e-6


def latest(deadline: Any) -> Any:
    """Returns the largest loop time that still completes by `deadline` (s, a number or an array of any kind)."""
    return deadline * (1.0 + ALLOWANCE)


def completes(loop_time: Any, deadline: Any) -> Any:
    """Tells which loops complete by their deadline.

    Args:
        loop_time: T_net (s), inf for a lost loop; a JAX or NumPy array of any shape.
        deadline: Finite deadline (s), of a shape that broadcasts with `loop_time`.

    Returns:
        Booleans of the broadcast shape.
    """
    return loop_time <= latest(deadline)
