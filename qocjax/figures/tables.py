"""Checks on the tables that figures are drawn from, and their rows as grids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from qocjax.figures.quantities import PARAMETERS, is_parameter
from qocjax.figures.style import POLICIES

__all__ = ["baseline_index", "check_table", "grid", "policy_rows", "present_sweeps", "sweep_rows"]

_TEXT = ("sweep", "policy")
_UNDEFINED_FOR_ONE_SEED = ("_se", "_low", "_high")


def check_table(table: pd.DataFrame, name: str, columns: Sequence[str], others: Sequence[str] = ()) -> None:
    """Checks that a table has rows, the columns, known sweeps, and numbers that can be drawn.

    Columns among `others` have to be there, whatever they hold. Standard errors and interval ends may be NaN, as they
    are for a single seed; nothing is drawn for them then.

    Raises:
        TypeError: `table` is not a DataFrame.
        ValueError: it is empty, lacks a column, or holds an unknown sweep or a value that is not a finite number.
    """
    if not isinstance(table, pd.DataFrame):
        raise TypeError(f"{name}: expected a pandas DataFrame, got {type(table).__name__}")
    for column in (*columns, *others):
        if column not in table.columns:
            raise ValueError(
                f"{name}: column '{column}' is missing; got {', '.join(map(str, table.columns)) or 'none'}"
            )
    if table.empty:
        raise ValueError(f"{name}: the table has no rows")
    for column in columns:
        if column in _TEXT:
            known = PARAMETERS if column == "sweep" else POLICIES
            for entry in table[column].unique():
                if entry not in known and not (column == "sweep" and is_parameter(entry)):
                    raise ValueError(f"{name}: unknown {column} '{entry}'; expected one of {', '.join(known)}")
        else:
            _check_numbers(table[column], name)


def _check_numbers(column: pd.Series, name: str) -> None:
    if not pd.api.types.is_numeric_dtype(column):
        raise ValueError(f"{name}: column '{column.name}' must hold numbers, got dtype {column.dtype}")
    numbers = column.to_numpy(dtype=float, na_value=np.nan)
    if str(column.name).endswith(_UNDEFINED_FOR_ONE_SEED):
        return
    bad = np.flatnonzero(~np.isfinite(numbers))
    if bad.size:
        raise ValueError(f"{name}: column '{column.name}' must be finite, got {numbers[bad[0]]} in row {bad[0]}")


def present_sweeps(table: pd.DataFrame) -> list[str]:
    """Lists the sweeps that occur in a table: those of the paper in its order, then the others."""
    found = dict.fromkeys(table["sweep"])
    return [*(sweep for sweep in PARAMETERS if sweep in found), *(sweep for sweep in found if sweep not in PARAMETERS)]


def sweep_rows(table: pd.DataFrame, name: str, sweep: str) -> pd.DataFrame:
    """Returns the rows of one sweep.

    Raises:
        ValueError: no such sweep exists, or the table has no row of it.
    """
    if not is_parameter(sweep):
        raise ValueError(f"sweep: unknown '{sweep}'; expected one of {', '.join(PARAMETERS)}")
    rows = table[table["sweep"] == sweep]
    if rows.empty:
        raise ValueError(f"sweep: {name} has no row of '{sweep}'; it has {', '.join(present_sweeps(table))}")
    return rows


def policy_rows(policies: pd.DataFrame, sweep: str) -> list[tuple[str, pd.Series]]:
    """Returns the rows of one sweep as (policy, row), in the order in which policies are drawn.

    Raises:
        ValueError: a policy occurs twice in the sweep.
    """
    rows = sweep_rows(policies, "policies", sweep)
    twice = rows["policy"][rows["policy"].duplicated()]
    if not twice.empty:
        raise ValueError(f"policies: '{twice.iloc[0]}' occurs more than once in sweep '{sweep}'")
    named = {str(row["policy"]): row for _, row in rows.iterrows()}
    return [(policy, named[policy]) for policy in POLICIES if policy in named]


def grid(rows: pd.DataFrame, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Arranges a column of one sweep over its values and deadlines.

    Returns:
        Values [V] and deadlines [D] (s), both ascending, and the column [V, D], NaN where the sweep has no such cell.

    Raises:
        ValueError: a cell occurs twice.
    """
    twice = rows[rows.duplicated(["value", "deadline"])]
    if not twice.empty:
        sweep, value, deadline = twice.iloc[0][["sweep", "value", "deadline"]]
        raise ValueError(f"results: sweep '{sweep}' has value {value} at deadline {deadline} s more than once")
    table = rows.pivot(index="value", columns="deadline", values=column).sort_index(axis=0).sort_index(axis=1)
    return table.index.to_numpy(float), table.columns.to_numpy(float), table.to_numpy(float)


def baseline_index(
    results: pd.DataFrame, sweep: str, values: NDArray[np.float64], baseline: Mapping[str, float] | None
) -> int | None:
    """Returns which of a sweep's values is the baseline, or None where that is not known.

    Without `baseline`, it is what the parameter is held at while the other sweeps vary theirs.
    """
    if baseline is not None and sweep in baseline:
        known = np.array([float(baseline[sweep])])
    elif sweep in results.columns:
        known = results.loc[results["sweep"] != sweep, sweep].unique().astype(float)
    else:
        return None
    if known.size != 1:
        return None
    match = np.flatnonzero(np.isclose(values, known[0], rtol=1e-6, atol=1e-9))
    return int(match[0]) if match.size else None
