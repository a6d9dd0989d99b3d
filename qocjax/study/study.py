"""What a study found, at hand in Python: tables, runs, and how it shows itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from qocjax import _checks
from qocjax._card import card
from qocjax.batch.evaluate import unit_of
from qocjax.quality import QocScale, qoc
from qocjax.store.gathered import worked_out
from qocjax.study.axes import axes_of, value_words
from qocjax.study.table import names_in

__all__ = ["Study"]


@dataclass(frozen=True, repr=False)
class Study:
    """What a study found: tables for people, and the runs behind them.

    The runs of a study that is written to a folder are read from there where they are looked at.
    """

    results: pd.DataFrame  # one row per (sweep, value, deadline), on the selection seeds
    policies: pd.DataFrame  # one row per (sweep, policy), judged on the evaluation seeds
    scale: QocScale
    runs: xr.Dataset  # metrics over (design, seed, robot), selection seeds
    evaluation: xr.Dataset  # metrics of the chosen designs on the evaluation seeds
    failures: Mapping[str, str] = field(default_factory=dict)  # why a chunk has no results, by its name
    chunks: Sequence[str] = ()  # names of those that have
    made_with: Sequence[Mapping[str, str]] = ()  # versions and devices of the processes that computed it, distinct
    configuration: Mapping[str, Any] | None = None  # the resolved options, where it was made from such
    network: Mapping[str, Any] = field(default_factory=dict)  # where loop times came from, as it describes itself

    def __repr__(self) -> str:
        """What it is, in a line; the tables have the rest."""
        return f"Study({', '.join(f'{name} {value}' for name, value in self._facts().items())})"

    def _repr_html_(self) -> str:
        """What it is, on which network, and the table of its policies, for notebooks."""
        return card("Study", self._facts(), _policies_shown(self.policies))

    def _facts(self) -> dict[str, str]:
        sizes, name = self.runs.sizes, self.network.get("name") or self.network.get("kind")
        seeds = f"{sizes['seed']} seeds, judged on {self.evaluation.sizes['seed']} others"
        facts = {
            "sweeps": ", ".join(dict.fromkeys(self.results["sweep"])),
            "network": str(name or "not recorded"),
            "designs": f"{sizes['design']} on {seeds}",
            "robots": str(sizes["robot"]),
            "J_med": f"{self.scale.median:.4g} s",
            "J_max": f"{self.scale.largest:.4g} s",
        }
        return facts | ({"chunks that failed": str(len(self.failures))} if self.failures else {})

    def sweep(self, name: str) -> xr.Dataset:
        """The selection runs of one sweep over (<name>, deadline, seed, robot); of several axes over each of them.

        With each run's metrics stands its QoC (`qoc`) on the scale of the study.

        Raises:
            ValueError: There is no such sweep.
        """
        _checks.choice("name", name, dict.fromkeys(self.results["sweep"]))
        rows = self.results[self.results["sweep"] == name]
        names = names_in(self.runs)
        points = zip(*(_nine(self.runs[each].values) for each in names), strict=True)
        at = {point: place for place, point in enumerate(points)}
        places = [at[point] for point in zip(*(_nine(rows[each].to_numpy()) for each in names), strict=True)]
        axes = {axis: rows[axis].unique() for axis in (*axes_of(name), "deadline")}
        grid = xr.DataArray(np.reshape(places, [len(values) for values in axes.values()]), dims=tuple(axes))
        scored = worked_out(self.runs["auc"].variable, lambda auc: np.asarray(qoc(auc, self.scale)), "1")
        runs = self.runs.drop_vars(names).assign(qoc=scored).isel(design=grid)
        return runs.assign_coords({axis: (axis, given, {"units": unit_of(axis)}) for axis, given in axes.items()})


def _nine(values: np.ndarray) -> list[str]:
    """Numbers to the digits of a CSV table."""
    return [f"{value:.9g}" for value in values]


def _policies_shown(policies: pd.DataFrame) -> pd.DataFrame:
    """What each policy chose, with the 95 % interval given the scale."""
    rows = [
        {
            "sweep": row["sweep"],
            "policy": row["policy"],
            "value": value_words(row),
            "Δ (ms)": row["deadline"] * 1e3,
            "F(Δ)": row["reliability"],
            "QoC": row["qoc"],
            "95 %": f"{row['qoc_low']:.4f} to {row['qoc_high']:.4f}",
            "runs with a collision": f"{row['collision_share']:.1%}",
        }
        for row in policies.to_dict("records")
    ]
    return pd.DataFrame(rows)
