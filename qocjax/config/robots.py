"""The robots of `conf/robot` that are unicycles, for comparison with recorded ones."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from qocjax.config.part import conf_dir

if TYPE_CHECKING:
    from qocjax.recorded.nearest import Preset

__all__ = ["UNICYCLE", "presets"]


UNICYCLE = "qocjax.robots.Unicycle"


@cache
def presets() -> tuple[Preset, ...]:
    """Every one, by name."""
    from qocjax.recorded.nearest import Preset  # with all that reads files

    found = []
    for path in sorted((conf_dir() / "robot").glob("*.yaml")):
        content: Any = OmegaConf.load(path)
        if content.get("_target_", UNICYCLE) == UNICYCLE:
            found.append(Preset(path.stem, content.v_max, content.omega_max, content.radius))
    return tuple(found)
