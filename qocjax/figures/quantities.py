"""Names, symbols and units of the quantities on the axes (model, section 1), and how their values are written."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DEADLINE_LABEL", "PARAMETERS", "RELIABILITY_LABEL", "Parameter", "milliseconds"]

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


def milliseconds(seconds: float) -> str:
    """Writes a time in milliseconds, without the unit."""
    return f"{1e3 * seconds:.4g}"
