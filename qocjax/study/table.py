"""The table of a study's results: a row per (sweep, value, deadline), computed a block of designs at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from qocjax.network.interface import Reliability
from qocjax.quality import QocScale
from qocjax.statistics.estimates import standard_error
from qocjax.statistics.scores import seed_scores
from qocjax.study.grid import Grid
from qocjax.units import unit_of

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["names_in", "qoc_by_seed", "results_table", "sound", "column_units"]

# Metrics of a run that are averaged over robots and seeds and reported with their standard error.
_AVERAGED = ("auc", "min_distance", "path_length", "effort", "completed_share", "age_mean", "age_peak")

# Numbers of one metric that are held at once, where one design alone has no more.
_BLOCK = 1 << 21


def names_in(runs: xr.Dataset) -> list[str]:
    """Names of the values of the designs of runs."""
    return [str(name) for name, axis in runs.coords.items() if axis.dims == ("design",) and name != "design"]


def qoc_by_seed(runs: xr.Dataset, scale: QocScale) -> np.ndarray:
    """QoC of each design and seed, [G, S]: mean over robots; a diverged run counts as the largest AUC."""
    return seed_scores(runs["auc"].values, scale)


def results_table(
    runs: xr.Dataset,
    grid: Grid,
    reliability: Reliability,
    scale: QocScale,
    failed: Mapping[int, str] | None = None,
    units: np.ndarray | None = None,
) -> pd.DataFrame:
    """One row per (sweep, value, deadline) with every metric and its standard error over seeds (SI units).

    Args:
        runs: Of the grid's designs; read a block at a time.
        grid: Its rows.
        reliability: F(Delta) of each design, [G].
        scale: Of the QoC.
        failed: Designs of which runs are missing, by their place, and why: their metrics are NaN, and a column `error`
            says why; without any there is no such column.
        units: [S] Labels of the seeds, see `column_units`.
    """
    blocks = [(places, _by_design(runs.isel(design=places).load(), scale, units)) for places in _blocks(runs)]
    designs = pd.concat([table.set_index(places) for places, table in blocks]).sort_index()
    place = names_in(runs)
    designs.insert(len(place), "reliability", reliability.share)
    designs.insert(len(place) + 1, "reliability_se", reliability.error)
    if failed:
        metrics = [name for name in designs.columns if name not in (*place, "reliability", "reliability_se", "seeds")]
        designs.loc[list(failed), metrics] = np.nan
        designs["error"] = [failed.get(k, "") for k in range(len(designs))]
    rows = designs.iloc[grid.design].reset_index(drop=True)
    table = pd.concat([pd.DataFrame({"sweep": grid.sweep, "value": grid.value}), rows], axis=1)
    table.insert(table.columns.get_loc("auc_se") + 1, "auc_normalised", _normalised(table))
    return table


def _normalised(table: pd.DataFrame) -> pd.Series:
    """AUC of each value over its deadlines on the paper's scale, 100 (S - min S) / (max S - min S) (Eq. 22).

    Infinite where AUC diverged, NaN where it failed, which are no ends of the scale; 0 on a curve that is flat, or has
    one deadline: each of its values is the smallest.
    """
    finite = table["auc"].where(np.isfinite(table["auc"]))
    curves = finite.groupby([table["sweep"], table["value"]], sort=False)
    low, span = curves.transform("min"), curves.transform("max") - curves.transform("min")
    return 100.0 * (table["auc"] - low.fillna(0.0)) / span.where(span > 0.0, 1.0)


def sound(results: pd.DataFrame, policies: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows of both tables that neither diverged nor failed, for what draws numbers.

    A sweep in which a policy has nothing to show is left out whole.
    """
    bad = policies.loc[~np.isfinite(policies[["value", "qoc", "auc"]]).all(axis=1), "sweep"].unique()
    held = (results["diverged_share"] == 0) & ~results["sweep"].isin(bad)
    tables = (results[held], policies[~policies["sweep"].isin(bad)])
    first, second = (table.drop(columns="error", errors="ignore").reset_index(drop=True) for table in tables)
    return first, second


def column_units(table: pd.DataFrame) -> dict[str, str]:
    """Unit of each column of a table of results or policies; 1 for shares, scores and counts."""
    plain = {name: name.removesuffix("_se") for name in table.columns}
    units = {name: unit_of(base) for name, base in plain.items()}
    text = {name: "" for name in table.columns if name in ("sweep", "policy", "error", "at_edge")}
    return units | text | {name: "unit of the swept parameter" for name in table.columns if name == "value"}


def _blocks(runs: xr.Dataset) -> Iterator[np.ndarray]:
    """Places of the designs in the order in which chunks hold them, so that each is read as rarely as possible."""
    order = np.lexsort((runs["deadline"].values, runs["tau"].values))
    rows = max(1, _BLOCK // (runs.sizes["seed"] * runs.sizes["robot"]))
    yield from np.split(order, range(rows, len(order), rows))


def _by_design(runs: xr.Dataset, scale: QocScale, units: np.ndarray | None) -> pd.DataFrame:
    designs = pd.DataFrame({name: runs[name].values for name in names_in(runs)})
    scores = qoc_by_seed(runs, scale)
    designs["qoc"], designs["qoc_se"] = scores.mean(axis=1), standard_error(scores, units=units)
    for name in _AVERAGED:
        values = runs[name].values.astype(np.float64)
        by_seed = values.mean(axis=-1) if values.ndim == 3 else values
        designs[name], designs[f"{name}_se"] = by_seed.mean(axis=1), standard_error(by_seed, units=units)
    designs["collision_share"] = runs["collided"].values.mean(axis=1)
    designs["diverged_share"] = np.any(~np.isfinite(runs["auc"].values), axis=2).mean(axis=1)
    _add_arrivals(designs, runs["arrival_time"].values)
    designs["seeds"] = runs.sizes["seed"]
    return designs


def _add_arrivals(designs: pd.DataFrame, arrival: np.ndarray) -> None:
    """Arrival time of a run is that of its last robot; mean over the runs in which all arrive, and their share."""
    last = arrival.max(axis=-1)
    arrived = np.isfinite(last)
    times = np.ma.masked_array(last, ~arrived)
    designs["arrived_share"] = arrived.mean(axis=1)
    designs["arrival_time"] = times.mean(axis=1).filled(np.inf)
    counts = np.maximum(arrived.sum(axis=1), 2)
    designs["arrival_time_se"] = np.where(
        arrived.sum(axis=1) > 1, times.std(axis=1, ddof=1).filled(0), np.inf
    ) / np.sqrt(counts)
