"""Three middlewares under QoS profiles and losses, measured, and the model of the transport beside them.

    python -m experiments.dds_testbed.compare [--measure] [--runs folder]

With --measure the runs are made first, 351 of about 20 s (see cases.py); those that the folder holds are kept, and
one that is rejected three times is left out. Without, the numbers of experiments/results/middlewares.csv are compared,
which needs neither root nor any middleware.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path

import jax
import numpy as np
import pandas as pd

from experiments.dds_testbed.cases import PROFILES, ROOT, Case, cases_of, measure, summarise
from experiments.dds_testbed.figure import draw
from experiments.dds_testbed.model import modelled, numbers_of
from qocjax.figures.save import save
from qocjax.quality import QocScale, qoc

__all__ = ["NUMBERS", "compare", "order_of_qoc"]

RESULTS = ROOT / "experiments" / "results"
_AUC = ["auc_0", "auc_1"]
_CASE = ["middleware", "profile", "loss", "bursty"]

# name of a number: its aim, and whether that is relative to what was measured; no aim for the last one
NUMBERS = {
    "lost": (0.02, False), "p50": (0.2, True), "p95": (0.2, True), "p99": (0.2, True), "age_mean": (0.2, True),
    "uplink_bytes": (0.2, True), "downlink_bytes": (0.2, True), "auc": (0.2, True), "qoc": (None, False),
}  # fmt: skip


def compare(measured: pd.DataFrame, model: Mapping[Case, Mapping[str, np.ndarray]]) -> pd.DataFrame:
    """One row per case and number: measured and modelled, error and aim.

    `spread` is the standard deviation of one run, that of the model's seeds or, where there is no model, of the runs.
    The error of `lost` and `qoc` is a difference, that of the others is relative to what was measured; `chance` says
    that it is within two standard errors of the difference.

    Args:
        measured: A row per run.
        model: Numbers of each seed by case; cases without a model are missing.
    """
    every = [measured[_AUC].to_numpy(), *(numbers["auc"] for numbers in model.values())]
    scale = QocScale.of(np.concatenate([auc.ravel() for auc in every]))
    rows = []
    for names, runs in measured.groupby(_CASE, sort=False):
        seen, drawn = _numbers(runs, runs[_AUC].to_numpy(), scale), model.get(Case(*names))
        found = None if drawn is None else _numbers(drawn, drawn["auc"], scale)
        for number in NUMBERS:
            row = dict(zip(_CASE, names, strict=True)) | {"number": number, "runs": len(runs)}
            rows.append(row | _beside(number, seen[number], None if found is None else found.get(number)))
    return pd.DataFrame(rows)


def _numbers(runs: Mapping[str, np.ndarray], auc: np.ndarray, scale: QocScale) -> dict[str, np.ndarray]:
    """Each number that there is of each run; `auc` [R, N]."""
    own = {name: np.asarray(runs[name], float) for name in NUMBERS if name in runs}
    return own | {"auc": auc.mean(axis=1), "qoc": np.asarray(qoc(auc, scale)).mean(axis=1)}


def _beside(number: str, seen: np.ndarray, found: np.ndarray | None) -> dict[str, float | str | bool | None]:
    """A row's values for the runs [R] and the model's seeds [S] of one number.

    A time is that of the runs in which a loop completes at all, and infinite where there are none.
    """
    seen = _finite(seen)
    mean = float(seen.mean())
    if found is None:
        return {"measured": mean, "spread": _spread(seen)}
    found = _finite(found)
    model, spread = float(found.mean()), _spread(found)
    aim, relative = NUMBERS[number]
    both = mean == model  # also where both are infinite
    error = 0.0 if both else (model - mean) / (mean if relative and np.isfinite(mean) else 1.0)
    return {
        "measured": mean, "spread": spread, "model": model, "error": error, "aim": aim,
        "met": "" if aim is None else "yes" if abs(error) <= aim else "no",
        "chance": both or bool(abs(model - mean) <= 2.0 * spread * np.sqrt(1.0 / seen.size + 1.0 / found.size)),
    }  # fmt: skip


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)] if np.isfinite(values).any() else values


def _spread(values: np.ndarray) -> float:
    """Standard deviation, NaN of a single value and where one is infinite."""
    return float(values.std(ddof=1)) if values.size > 1 and np.isfinite(values).all() else np.nan


def order_of_qoc(table: pd.DataFrame) -> pd.DataFrame:
    """Pairs of profiles of a middleware on a channel: difference of QoC, measured and modelled, and if the signs agree.

    `clear` says that the measured difference is more than two standard errors of the mean over the runs.
    """
    rows = []
    of_qoc = table[(table["number"] == "qoc") & table["model"].notna()]
    for (middleware, loss, bursty), channel in of_qoc.groupby(["middleware", "loss", "bursty"], sort=False):
        for one, other in combinations(channel.itertuples(), 2):
            measured, model = other.measured - one.measured, other.model - one.model
            error = np.hypot(one.spread / np.sqrt(one.runs), other.spread / np.sqrt(other.runs))
            rows.append({
                "middleware": middleware, "loss": loss, "bursty": bursty, "pair": f"{other.profile} - {one.profile}",
                "measured": measured, "model": model, "clear": abs(measured) > 2.0 * error,
                "agree": measured * model > 0.0,
            })  # fmt: skip
    return pd.DataFrame(rows)


def _account(table: pd.DataFrame, order: pd.DataFrame) -> Iterator[str]:
    judged = table[table["met"].isin(["yes", "no"])]
    for (middleware, number), each in judged.groupby(["middleware", "number"], sort=False):
        aim, relative = NUMBERS[number]
        within = f"{aim:.0%}" if relative else f"{100 * aim:g} points"
        errors, missed = each["error"].abs(), each[each["met"] == "no"]
        yield (f"{middleware:11}{number:15}{len(each) - len(missed):2} of {len(each)} within {within}, and "
               f"{int(missed['chance'].astype(bool).sum())} of the others by chance; error: median "
               f"{errors.median():.1%}, largest {errors.max():.1%}")  # fmt: skip
    for middleware, pairs in order.groupby("middleware", sort=False):
        clear = pairs[pairs["clear"]]
        yield (f"{middleware:11}order of QoC: {clear['agree'].sum()} of {len(clear)} pairs that differ clearly, "
               f"{pairs['agree'].sum()} of {len(pairs)} in all")  # fmt: skip


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measure", action="store_true", help="make the runs that the folder does not hold")
    parser.add_argument("--runs", type=Path, default=Path("results/middlewares"), help="folder of the runs")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    cases = cases_of(PROFILES)
    paths = RESULTS / "middlewares.csv", RESULTS / "middlewares_quantiles.csv"
    if options.measure:
        for run in measure(cases, options.runs):
            print(f"left out: {run}, rejected each time: expected a quieter machine")
        for table, path in zip(summarise(cases, options.runs), paths, strict=True):
            table.to_csv(path, index=False, float_format="%.6g")
    measured, quantiles = (pd.read_csv(path) for path in paths)
    model = {case: numbers_of(case) for case in cases if modelled(case)}
    table = compare(measured, {case: numbers for case, (numbers, _) in model.items()})
    order = order_of_qoc(table)
    table.to_csv(RESULTS / "middlewares_model.csv", index=False, float_format="%.5g")
    order.to_csv(RESULTS / "middlewares_order.csv", index=False, float_format="%.4g")
    save(draw(table, quantiles, {case.name: times for case, (_, times) in model.items()}), RESULTS / "middlewares")
    print("\n".join(_account(table, order)))


if __name__ == "__main__":
    main()
