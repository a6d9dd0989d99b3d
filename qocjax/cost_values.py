"""Nav2's scale of costs of a cell (nav2_costmap_2d/cost_values.hpp)."""

from __future__ import annotations

__all__ = ["FREE", "INSCRIBED", "LETHAL", "UNKNOWN"]

FREE = 0
INSCRIBED = 253  # from here on, a round robot's centre may not be there
LETHAL = 254
UNKNOWN = 255
