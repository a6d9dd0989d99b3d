"""Bounds of the continuous parameters of a design, as a part of a configuration."""

from __future__ import annotations

from collections.abc import Callable

from qocjax.config.part import Part

__all__ = ["BoundsConfig"]


class BoundsConfig(Part):
    """Between what each parameter may lie; null leaves it alone."""

    kappa: list[float] | None
    gamma: list[float] | None
    eta: list[float] | None
    c_miss: list[float] | None
    v_max: list[float] | None
    omega_max: list[float] | None
    d_safe: list[float] | None

    def build(self, name: str, limit: Callable[[str], float | None] = lambda parameter: None
              ) -> dict[str, tuple[float, float]]:  # fmt: skip
        """Lower and upper bounds of the parameters that may change.

        Args:
            name: Of this part, for messages.
            limit: What the robot can do at most, where upper bounds end.

        Raises:
            ValueError: Not two numbers, the first below the second.
        """
        found = {}
        for parameter in type(self).model_fields:
            ends = getattr(self, parameter)
            if ends is None:
                continue
            if len(ends) != 2 or not ends[0] < ends[1]:
                raise ValueError(f"{name}.{parameter}: got {ends}, expected [low, high] with low < high, or null")
            most = limit(parameter)
            if most is not None and ends[0] >= most:
                raise ValueError(f"{name}.{parameter}: got {ends}, expected [low, high] below the robot's {most:g}")
            found[parameter] = (ends[0], ends[1] if most is None else min(ends[1], most))
        return found
