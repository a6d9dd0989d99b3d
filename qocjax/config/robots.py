"""The robots of `conf/robot`, for comparison with recorded ones."""

from __future__ import annotations

from functools import cache

from omegaconf import OmegaConf

from qocjax.config.part import conf_dir
from qocjax.recorded.nearest import Preset

__all__ = ["presets"]


@cache
def presets() -> tuple[Preset, ...]:
    """Every preset, by name."""
    found = []
    for path in sorted((conf_dir() / "robot").glob("*.yaml")):
        content = OmegaConf.load(path)
        found.append(Preset(path.stem, content.v_max, content.omega_max, content.radius))
    return tuple(found)
