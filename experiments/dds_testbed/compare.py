"""Measured BEST_EFFORT and RELIABLE against the model of the transport: a table, and a figure.

    python -m experiments.dds_testbed.compare [--measure] [--runs folder]

With --measure the runs are made first, 15 of about half a minute each (see cases.py); those that the folder holds are
kept. Without, the numbers of experiments/results/dds_testbed_measured.csv are compared, which needs neither root nor
the middleware.
"""

from __future__ import annotations

import argparse
from itertools import combinations
from pathlib import Path

import jax
import numpy as np
import pandas as pd

from experiments.dds_testbed.cases import CASES, NUMBERS, ROOT, measure, summarise
from experiments.dds_testbed.figure import draw
from experiments.dds_testbed.model import numbers_of
from qocjax.figures.save import save
from qocjax.quality import QocScale, qoc

__all__ = ["compare", "order_of_qoc"]

RESULTS = ROOT / "experiments" / "results"
_AUC = ["auc_0", "auc_1"]


def compare(measured: pd.DataFrame, modelled: dict[str, dict[str, np.ndarray]]) -> pd.DataFrame:
    """One row per case and number: measured, model (mean over its seeds), error and aim.

    `spread` is the standard deviation over the model's seeds, that is, of one run of the measured length. The error of
    `lost` and `qoc` is a difference, that of the others is relative to what was measured.

    Args:
        measured: A row per case.
        modelled: Numbers of each seed, by the case's name.
    """
    scale = QocScale.of(
        np.concatenate([measured[_AUC].to_numpy().ravel(), *(m["auc"].ravel() for m in modelled.values())])
    )
    rows = []
    for case, (_, row) in zip(CASES, measured.iterrows(), strict=True):
        model, auc = modelled[case.name], row[_AUC].to_numpy(float)
        drawn = model | {"auc": model["auc"].mean(axis=1), "qoc": np.asarray(qoc(model["auc"], scale)).mean(axis=1)}
        seen = row.to_dict() | {"auc": auc.mean(), "qoc": np.asarray(qoc(auc, scale)).mean()}
        for number, (aim, relative) in NUMBERS.items():
            mean, spread = drawn[number].mean(), drawn[number].std(ddof=1)
            error = (mean - seen[number]) / (seen[number] if relative else 1.0)
            rows.append({
                "loss": case.loss, "bursty": case.bursty, "profile": case.profile, "number": number,
                "measured": seen[number], "model": mean, "spread": spread, "error": error, "aim": aim,
                "met": "" if aim is None else "yes" if abs(error) <= aim else "no",
            })  # fmt: skip
    return pd.DataFrame(rows)


def order_of_qoc(table: pd.DataFrame) -> pd.DataFrame:
    """For each channel, pairs of profiles: difference of QoC measured and modelled, and whether their signs agree.

    `clear` says that the measured difference is more than two standard deviations of a single run's.
    """
    rows = []
    of_qoc = table[table["number"] == "qoc"]
    for (loss, bursty), channel in of_qoc.groupby(["loss", "bursty"]):
        for one, other in combinations(channel.itertuples(), 2):
            measured, model = other.measured - one.measured, other.model - one.model
            rows.append({
                "loss": loss, "bursty": bursty, "pair": f"{other.profile} - {one.profile}", "measured": measured,
                "model": model, "clear": abs(measured) > 2.0 * np.hypot(one.spread, other.spread),
                "agree": measured * model > 0.0,
            })  # fmt: skip
    return pd.DataFrame(rows)


def _account(table: pd.DataFrame, order: pd.DataFrame) -> str:
    judged = table[table["met"] != ""]
    rows = [
        f"{number:15} {(each['met'] == 'yes').sum():2} of {len(each)} within "
        + (f"{NUMBERS[number][0]:.0%}" if NUMBERS[number][1] else f"{100 * NUMBERS[number][0]:g} points")
        + f"; error: median {each['error'].abs().median():.1%}, largest {each['error'].abs().max():.1%}"
        for number, each in judged.groupby("number", sort=False)
    ]  # fmt: skip
    missed = judged[judged["met"] == "no"]
    by_chance = ((missed["model"] - missed["measured"]).abs() <= 2.0 * missed["spread"]).sum()
    rows += [f"missed          {len(missed)}, of which {by_chance} within two standard deviations of one run"]
    clear = order[order["clear"]]
    rows += [f"order of QoC    {clear['agree'].sum()} of {len(clear)} pairs that differ clearly, "
             f"{order['agree'].sum()} of {len(order)} in all"]  # fmt: skip
    return "\n".join(rows)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measure", action="store_true", help="make the runs that the folder does not hold")
    parser.add_argument("--runs", type=Path, default=Path("results/dds_testbed"), help="folder of the runs")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    paths = RESULTS / "dds_testbed_measured.csv", RESULTS / "dds_testbed_quantiles.csv"
    if options.measure:
        measure(CASES, options.runs)
        for table, path in zip(summarise(CASES, options.runs), paths, strict=True):
            table.to_csv(path, index=False, float_format="%.6g")
    measured, quantiles = (pd.read_csv(path) for path in paths)
    modelled = {case.name: numbers_of(case) for case in CASES}
    table = compare(measured, {name: numbers for name, (numbers, _) in modelled.items()})
    order = order_of_qoc(table)
    table.to_csv(RESULTS / "dds_testbed.csv", index=False, float_format="%.5g")
    save(draw(table, quantiles, {name: times for name, (_, times) in modelled.items()}), RESULTS / "dds_testbed")
    print(_account(table, order))
    print(order.to_string(index=False, float_format="%.4f"))


if __name__ == "__main__":
    main()
