"""Names, symbols and units as HTML; Plotly's labels take the same few tags."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from qocjax.figures.quantities import parameter
from qocjax.report.html import escape, number
from qocjax.study.axes import axes_of, is_joint, values_of

__all__ = [
    "DEADLINE", "MARKERS", "RELIABILITY", "choice_words", "label", "name_of", "symbol", "unit", "value_cell",
    "value_text", "values_words",
]  # fmt: skip

DEADLINE = "Deadline Δ (ms)"
RELIABILITY = "Loop completion <i>F</i>(Δ)"

# Plotly's symbols for those of the figures' policies.
MARKERS = {"Co-design": "star", "MinDelay": "circle", "MaxRel": "square"}

_SYMBOLS = {
    "v_max": "<i>ν</i><sup>max</sup>", "omega_max": "<i>ω</i><sup>max</sup>", "eta": "<i>η</i>", "tau": "<i>τ</i>",
    "kappa": "<i>κ</i>", "gamma": "<i>γ</i>", "c_miss": "<i>c</i><sub>miss</sub>", "d_safe": "<i>d</i><sub>safe</sub>",
}  # fmt: skip


def name_of(sweep: str) -> str:
    """A parameter in words."""
    return escape(parameter(sweep).name)


def symbol(sweep: str) -> str:
    """A parameter's symbol; of several those of each."""
    if is_joint(sweep):
        return ", ".join(symbol(each) for each in axes_of(sweep))
    return _SYMBOLS.get(sweep) or escape(parameter(sweep).symbol)


def unit(sweep: str) -> str:
    """The unit that its values are shown in; empty for plain numbers."""
    return escape(parameter(sweep).unit)


def label(sweep: str) -> str:
    """Symbol and unit, for an axis."""
    return f"{symbol(sweep)} ({unit(sweep)})" if unit(sweep) else symbol(sweep)


def value_text(sweep: str, value: float, *, with_unit: bool = False) -> str:
    """An SI value in the shown unit."""
    text = number(parameter(sweep).scale * value)
    return f"{text} {unit(sweep)}" if with_unit and unit(sweep) else text


def value_cell(row: Mapping[str, Any], prefix: str = "") -> str:
    """The value of a row of results or policies with its unit, see `values_of`; of several parameters each one's."""
    return ", ".join(value_text(axis, value, with_unit=True) for axis, value in values_of(row, prefix).items())


def choice_words(row: Mapping[str, Any], prefix: str = "") -> str:
    """As `value_cell`, each value behind its symbol: `κ = 2 1/s`."""
    return values_words(values_of(row, prefix))


def values_words(values: Mapping[str, Any]) -> str:
    """Values by parameter, each behind its symbol."""
    return ", ".join(f"{symbol(axis)} = {value_text(axis, value, with_unit=True)}" for axis, value in values.items())
