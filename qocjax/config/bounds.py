"""Bounds of the parameters that a search may change, as a part of a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator

from qocjax.config.options import flat
from qocjax.config.simulation import SimulationConfig
from qocjax.tunables import CONTINUOUS, design_name

__all__ = ["Bounds", "built_bounds"]

# By name in a design or in the configuration, such as `controller.mppi.temperature`; null leaves a parameter alone.
Bounds = Annotated[dict[str, list[float] | None], BeforeValidator(flat)]


def built_bounds(
    option: str, given: Mapping[str, list[float] | None], config: SimulationConfig, limited: bool = True
) -> dict[str, tuple[float, float]]:
    """Lower and upper bounds of the parameters that may change, by name in a design; without what the robot ignores.

    Args:
        option: That holds them, for messages.
        given: From the configuration.
        config: With the robot, whose limits end upper bounds, and the law, which says what it declares.
        limited: Whether the robot's limits end them.

    Raises:
        ValueError: An unknown name, one that the law does not read or that no program takes as an array, or not two
            numbers, the first below the second.
    """
    found: dict[str, tuple[float, float]] = {}
    free = {design_name(name): ends for name, ends in given.items() if ends is not None}
    free = {name: ends for name, ends in free.items() if name not in config.robot.unread}
    declared = config.tunables() if any(name not in CONTINUOUS for name in free) else {}
    known = [*CONTINUOUS, *(each for each, own in declared.items() if own.array and "." in each)]
    for name, ends in free.items():
        if name in config.controller.declares().unread:
            raise ValueError(f"{option}.{name}: got {ends}, expected null: controller={config.controller.law} does not "
                             "read it")  # fmt: skip
        if name not in known:
            raise ValueError(f"{option}: got {name}, expected one of {', '.join(known)}")
        if len(ends) != 2 or not ends[0] < ends[1]:
            raise ValueError(f"{option}.{name}: got {ends}, expected [low, high] with low < high, or null")
        if name in declared:
            declared[name].check(np.asarray(ends, float))
        most = config.robot.limit(name) if limited else None
        if most is not None and ends[0] >= most:
            raise ValueError(f"{option}.{name}: got {ends}, expected [low, high] below the robot's {most:g}")
        found[name] = (ends[0], ends[1] if most is None else min(ends[1], most))
    return found
