"""Configuration of a law from outside the package: a class by its full name, as Hydra's `instantiate` has it.

Building it imports its module: a configuration file with `_target_` runs code.
"""

from __future__ import annotations

import json
from typing import Any

from pydantic import ConfigDict, Field, model_serializer

from qocjax.config.part import Part
from qocjax.config.target import GAINS, law_of
from qocjax.controllers import Controller
from qocjax.controllers.trial import try_out
from qocjax.scenario import Scenario

__all__ = ["CustomConfig"]


class CustomConfig(Part):
    """Class of the law, values of the baseline design, and the class's own arguments beside them."""

    model_config = ConfigDict(extra="allow")

    target: str = Field(alias="_target_")
    kappa: float | None = None
    eta: float | None = None
    gamma: float | None = None
    c_miss: float | None = None
    d_safe: float | None = None

    @property
    def law(self) -> str:
        """What it is called in messages."""
        return self.target

    @model_serializer
    def _plain(self) -> dict[str, Any]:
        return {"_target_": self.target, **self._given(), **(self.model_extra or {})}

    def _given(self) -> dict[str, float]:
        values = {name: getattr(self, name) for name in GAINS}
        return {name: value for name, value in values.items() if value is not None}

    def gains(self) -> dict[str, float]:
        """Values of the baseline design; those that the law does not read may be left out.

        Raises:
            ValueError: One is missing that it reads, or what `made` raises.
        """
        given, unread = self._given(), self.made().unread
        for name in GAINS:
            if name not in given and name not in unread:
                raise ValueError(f"controller.{name}: got nothing, expected the value of the baseline design, or "
                                 f"{name!r} in {self.target}.unread")  # fmt: skip
        return given

    def declares(self) -> Any:
        """The law or its class, which says what may be chosen of it and what it reads; reads no file."""
        return self.made()

    def made(self) -> Controller:
        """The law.

        Raises:
            ValueError: There is no such class, it is no controller, or it does not take the arguments.
        """
        return law_of(self.target, json.dumps(self.model_extra or {}))

    def build(self, scenario: Scenario, map_name: str | None, wz_max: float, release: str = "jazzy") -> Controller:
        """The law, tried out; it knows no map.

        Raises:
            ValueError: What `made` raises, or a method of the law fails.
        """
        law = self.made()
        try:
            try_out(law, scenario.num_robots, scenario.robot)
        except ValueError as error:
            raise ValueError(f"controller: got {self.target}, which fails in a batch of runs: {error}") from error
        return law
