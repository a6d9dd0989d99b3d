"""Recorded runs that share their labels, taken together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from qocjax.statistics.estimates import estimate

__all__ = ["group_table"]


def group_table(table: pd.DataFrame, labels: Sequence[str]) -> pd.DataFrame:
    """Means over the runs that share all labels, with 95 % Student intervals where there are two runs or more."""
    measures = [name for name in ("auc", "qoc", "min_distance", "path_length", "loop_p50", "loop_p99", "lost_share")
                if name in table and np.isfinite(pd.to_numeric(table[name], errors="coerce")).any()]  # fmt: skip
    rows = []
    for key, group in table.groupby(list(labels), dropna=False, sort=True):
        row: dict = dict(zip(labels, key, strict=True)) | {"runs": len(group)}
        for name in measures:
            values = pd.to_numeric(group[name]).replace([np.inf, -np.inf], np.nan).dropna().to_numpy()
            row[name] = values.mean() if values.size else np.nan
            if values.size > 1:
                found = estimate(values)
                row |= {f"{name}_low": found.low, f"{name}_high": found.high}
        rows.append(row)
    return pd.DataFrame(rows)
