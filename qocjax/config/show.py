"""Configuration of `python -m qocjax.show`."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import Annotated

import numpy as np
from pydantic import Field

from qocjax import _checks
from qocjax.config.part import Part
from qocjax.config.simulation import SimulationConfig
from qocjax.scenario import Design

__all__ = ["ShowConfig"]


_FRAME = 10_000  # bytes of a frame of a film, at least


class ShowOptions(Part):
    """Which run, and what of it is drawn."""

    seed: Annotated[int, Field(ge=0, lt=2**32)]
    deadline_ms: float
    at: float | None
    robot: int
    format: str
    fps: float
    until: float | None


class ShowConfig(SimulationConfig):
    """Everything that `python -m qocjax.show` reads."""

    show: ShowOptions
    nav2: str | None
    figures: bool
    bag: bool

    def sizes(self) -> dict[str, float]:
        """Of the frames of a film."""
        part = self.show
        seconds = self.scenario.horizon if part.until is None else min(part.until, self.scenario.horizon)
        return {"show.fps": _FRAME * seconds * part.fps if self.figures else 0.0}

    def build_design(self) -> Design:
        """The design that is shown.

        Raises:
            ValueError: A value of it, or of what is drawn, is out of range.
        """
        options = self.show
        _checks.bounded("show.deadline_ms", options.deadline_ms, least=0)
        if options.format != "gif":  # which needs nothing, and what draws takes as long to import as JAX
            from qocjax.figures.film import FORMATS, find_ffmpeg

            if _checks.choice("show.format", options.format, FORMATS) == "mp4" and self.figures:
                find_ffmpeg()
        _checks.bounded("show.fps", options.fps, above=0, most=100)
        if options.at is not None:
            _checks.bounded("show.at", options.at, least=0, most=self.scenario.horizon)
        if options.until is not None:
            _checks.bounded("show.until", options.until, above=0)
        robots = len(self.scenario.start)
        if not 1 <= options.robot <= robots:
            raise ValueError(f"show.robot: got {options.robot}, expected 1 to {robots}")
        if self.bag and find_spec("rosbags") is None:
            raise ValueError("bag: got true, which needs rosbags, expected it installed: pip install 'qocjax[ros]'")
        return replace(self.baseline(), deadline=np.float64(options.deadline_ms) / 1e3)
