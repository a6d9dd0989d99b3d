"""Names, symbols and units of the quantities on the axes (model, section 1), and how their values are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from qocjax.study.axes import axes_of, is_joint, values_of
from qocjax.tunables import DESIGN
from qocjax.units import unit_of

__all__ = [
    "DEADLINE_LABEL", "PARAMETERS", "RELIABILITY_LABEL", "Parameter", "is_parameter", "milliseconds", "parameter",
    "short_name", "value_text",
]  # fmt: skip

DEADLINE_LABEL = r"Deadline $\Delta$ (ms)"
RELIABILITY_LABEL = r"Loop completion $F(\Delta)$"


@dataclass(frozen=True)
class Parameter:
    """One design parameter as a reader sees it."""

    name: str
    symbol: str
    unit: str = ""
    scale: float = 1.0  # displayed value = scale · SI value

    @property
    def label(self) -> str:
        """Symbol and unit, for an axis."""
        return f"{self.symbol} ({self.unit})" if self.unit else self.symbol

    def format(self, value: float) -> str:
        """Writes an SI value in the displayed unit, without the unit."""
        return f"{self.scale * value:.4g}"


# In the paper's order, which is the order of the groups in a bar chart.
PARAMETERS = {
    "v_max": Parameter("Speed cap", r"$\nu^\mathrm{max}$", "m/s"),
    "eta": Parameter("Repulsion gain", r"$\eta$"),
    "tau": Parameter("Sampling period", r"$\tau$", "ms", 1e3),
    "kappa": Parameter("Goal gain", r"$\kappa$", "1/s"),
    "gamma": Parameter("Heading gain", r"$\gamma$", "1/s"),
    "c_miss": Parameter("Staleness penalty", r"$c_\mathrm{miss}$", "m/s"),
}


_BESIDE = {
    "omega_max": Parameter("Turn rate cap", r"$\omega^\mathrm{max}$", "rad/s"),
    "d_safe": Parameter("Safety distance", r"$d_\mathrm{safe}$", "m"),
}


def parameter(name: str) -> Parameter:
    """A parameter by its name in a design; of several, `kappa,gamma`, the symbols in their order."""
    if is_joint(name):
        axes = axes_of(name)
        names = ", ".join(parameter(each).name.lower() for each in axes)
        return Parameter(names.capitalize(), ", ".join(parameter(each).symbol for each in axes))
    if name in PARAMETERS or name in _BESIDE:
        return PARAMETERS.get(name) or _BESIDE[name]
    unit = unit_of(name)
    return Parameter(name, short_name(name), "" if unit == "1" else unit)


def short_name(name: str) -> str:
    """The end of an option's name that tells it from others: `temperature`, `CostCritic.cost_weight`."""
    return ".".join(name.split(".")[-2 if ".critics." in name or name.endswith("gamma") else -1 :])


def is_parameter(name: object) -> bool:
    """Whether a sweep may have that name."""
    return isinstance(name, str) and all(each in DESIGN or "." in each for each in axes_of(name))


def value_text(row: Mapping[str, Any]) -> str:
    """The value of a row of results or policies in the displayed units; of several parameters each one's."""
    return ", ".join(parameter(axis).format(value) for axis, value in values_of(row).items())


def milliseconds(seconds: float) -> str:
    """Writes a time in milliseconds, without the unit."""
    return f"{1e3 * seconds:.4g}"
