"""Configuration of a robot: its caps and size, and which class makes it move."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer

from qocjax.config.part import Part
from qocjax.config.target import class_of
from qocjax.robots import Acceleration, Robot
from qocjax.store.sources import source_of

__all__ = ["RobotConfig"]

_LIMITS = {"v_max": "v_limit", "omega_max": "omega_limit"}


class RobotConfig(Part):
    """Speed caps, size, how fast speeds change, and the class with what else it asks for."""

    model_config = ConfigDict(extra="allow", populate_by_name=True)

    target: str = Field("qocjax.robots.Unicycle", alias="_target_")
    v_max: float
    omega_max: float
    radius: float
    v_limit: float | None = None
    omega_limit: float | None = None
    ax_max: float | None = None
    ax_min: float | None = None
    az_max: float | None = None

    @model_serializer(mode="wrap")
    def _dump(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """As it is written in a file."""
        values = plain(self)
        return {"_target_": values.pop("target", self.target), **values}

    def build(self) -> Robot:
        """The robot.

        Raises:
            ValueError: There is no such class, or it knows no such option.
        """
        kind, given = self.kind(), dict(self.model_extra or {})
        known = [each.name for each in fields(kind)]  # type: ignore[arg-type]
        own = [name for name in known if name != "acceleration"]
        for name in given:
            if name not in own:
                expected = f"one of {', '.join(own)}" if own else "none of its own"
                raise ValueError(f"robot.{name}: got an unknown option of {kind.__name__}, expected {expected}")
        limits = {name: getattr(self, name) for name in ("ax_max", "ax_min", "az_max")}
        found = {name: value for name, value in limits.items() if value is not None}
        if found and "acceleration" not in known:
            name, value = next(iter(found.items()))
            raise ValueError(f"robot.{name}: got {value:g}, but {kind.__name__} obeys commands at once, expected null")
        robot = kind(**given, **({"acceleration": Acceleration(**found)} if found else {}))
        source_of(robot)  # takes note of the file as it is now
        return robot

    def kind(self) -> type[Robot]:
        """The class of the robot.

        Raises:
            ValueError: There is none of this name.
        """
        found = class_of("robot._target_", self.target)
        if issubclass(found, Robot) and hasattr(found, "__dataclass_fields__"):
            return found
        raise ValueError(f"robot._target_: got {self.target}, expected the full name of a class, such as "
                         "qocjax.robots.Unicycle, that is a Robot and a dataclass")  # fmt: skip

    @property
    def unread(self) -> tuple[str, ...]:
        """Values of a design that it does not read."""
        return self.kind().unread

    def limit(self, parameter: str) -> float | None:
        """What the robot can do at most, of `v_max` or `omega_max`; None for any other and where no limit is known."""
        return {"v_max": self.v_limit, "omega_max": self.omega_limit}.get(parameter)

    def within(self, option: str, parameter: str, values: list[float]) -> list[float]:
        """The values of a list that the robot can do.

        Raises:
            ValueError: None of them.
        """
        most = self.limit(parameter)
        kept = values if most is None else [value for value in values if value <= most]
        if values and not kept:
            raise ValueError(f"{option}: got {values}, expected some up to {most:g}, what the robot can do "
                             f"(robot.{_LIMITS[parameter]}=null takes any)")  # fmt: skip
        return kept

    def check(self) -> None:
        """Checks that the caps are what the robot can do.

        Raises:
            ValueError: One is more.
        """
        for parameter, option in _LIMITS.items():
            most = self.limit(parameter)
            if most is not None and getattr(self, parameter) > most:
                got = getattr(self, parameter)
                raise ValueError(f"robot.{parameter}: got {got:g}, expected at most robot.{option}, {most:g}")
