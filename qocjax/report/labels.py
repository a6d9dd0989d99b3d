"""Names, symbols and units as HTML; Plotly's labels take the same few tags."""

from __future__ import annotations

from qocjax.figures.quantities import PARAMETERS, Parameter
from qocjax.report.html import escape, number

__all__ = ["DEADLINE", "MARKERS", "RELIABILITY", "label", "name_of", "symbol", "unit", "value_text"]

DEADLINE = "Deadline Δ (ms)"
RELIABILITY = "Loop completion <i>F</i>(Δ)"

# Plotly's symbols for those of the figures' policies.
MARKERS = {"Co-design": "star", "MinDelay": "circle", "MaxRel": "square"}

_SYMBOLS = {
    "v_max": "<i>ν</i><sup>max</sup>", "omega_max": "<i>ω</i><sup>max</sup>", "eta": "<i>η</i>", "tau": "<i>τ</i>",
    "kappa": "<i>κ</i>", "gamma": "<i>γ</i>", "c_miss": "<i>c</i><sub>miss</sub>", "d_safe": "<i>d</i><sub>safe</sub>",
}  # fmt: skip
_OTHERS = {
    "omega_max": Parameter("Turn rate cap", "", "rad/s"),
    "d_safe": Parameter("Safety distance", "", "m"),
}


def _parameter(sweep: str) -> Parameter:
    return PARAMETERS.get(sweep) or _OTHERS.get(sweep) or Parameter(sweep, sweep)


def name_of(sweep: str) -> str:
    """A parameter in words."""
    return escape(_parameter(sweep).name)


def symbol(sweep: str) -> str:
    """A parameter's symbol."""
    return _SYMBOLS.get(sweep) or escape(sweep)


def unit(sweep: str) -> str:
    """The unit that its values are shown in; empty for plain numbers."""
    return escape(_parameter(sweep).unit)


def label(sweep: str) -> str:
    """Symbol and unit, for an axis."""
    return f"{symbol(sweep)} ({unit(sweep)})" if unit(sweep) else symbol(sweep)


def value_text(sweep: str, value: float, *, with_unit: bool = False) -> str:
    """An SI value in the shown unit."""
    text = number(_parameter(sweep).scale * value)
    return f"{text} {unit(sweep)}" if with_unit and unit(sweep) else text
