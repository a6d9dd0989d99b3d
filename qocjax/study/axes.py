"""What a sweep varies, by its name in a table; needs nothing that simulates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["axes_of", "is_joint", "value_words", "values_of"]


def axes_of(sweep: str) -> tuple[str, ...]:
    """The parameters that a sweep varies: one, or with `kappa,gamma` each of them."""
    return tuple(sweep.split(","))


def is_joint(sweep: str) -> bool:
    """Whether a sweep varies several parameters at once."""
    return len(axes_of(sweep)) > 1


def values_of(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The values of what its sweep varies in a row of results or policies, by parameter.

    Args:
        row: With its sweep and the column `value`, or a column for each of several parameters.
        prefix: Of these columns.
    """
    axes = axes_of(str(row["sweep"]))
    return {axis: row[f"{prefix}{'value' if len(axes) == 1 else axis}"] for axis in axes}


def value_words(row: Mapping[str, Any], prefix: str = "") -> str:
    """The value of a row for a reader, see `values_of`; of several parameters each one's, in their order."""
    return ", ".join(f"{value:g}" for value in values_of(row, prefix).values())
