"""Where a policy's choice is found again: its design, and its place among the runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.scenario import Design
from qocjax.tunables import DESIGN

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["design_at", "design_of", "place_of"]


def design_of(results: pd.DataFrame, choice: Mapping[str, Any]) -> Design:
    """The design of a choice: the row of the results with its sweep, value and deadline.

    Raises:
        ValueError: There is no such row.
    """
    same = np.all([results[name] == choice[name] for name in ("sweep", "value", "deadline")], axis=0)
    if not same.any():
        raise ValueError(
            f"policies: got the choice {choice['value']} at deadline {choice['deadline']} s in sweep "
            f"'{choice['sweep']}', expected one of the rows of the results"
        )
    point = results[same].iloc[0]
    return design_at(point)


def design_at(row: pd.Series) -> Design:
    """The design of a row of a study's results."""
    names = list(row.index)
    return Design.of({name: float(row[name]) for name in names[names.index(DESIGN[0]) : names.index("reliability")]})


def place_of(runs: xr.Dataset, design: Design) -> int:
    """Where a design lies in the runs.

    Raises:
        ValueError: It does not.
    """
    same = [np.isclose(runs[name].values, value) for name, value in design.values().items()]
    found = np.flatnonzero(np.all(same, axis=0))
    if not found.size:
        raise ValueError(f"runs: got none of {design}, expected the runs of the same study")
    return int(found[0])
