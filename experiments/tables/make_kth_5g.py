"""Derives qocjax/network/tables/kth_5g.csv from the two histograms that it stands for.

    python experiments/tables/make_kth_5g.py UPLINK.xml DOWNLINK.xml qocjax/network/tables/kth_5g.csv

The histograms are 5g-kth/s1_wall.xml (uplink) and 5g-kth/s10-DL_wall.xml (downlink) of the DETERMINISTIC6G repository
deterministic6g_data at commit 0aae4f35717335888d75234c2e4cddc19924467d.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from qocjax.network import QuantileTable, read_histogram

HEADER = """\
# Quantiles (s) of one-way delays measured on a private 5G network at KTH: bins of histograms reduced to quantiles.
# Source: Sharma et al., IEEE Access 11:106898-106923, 2023; data of deterministic6g_data. CC BY-SA 4.0, see README.md.
probability,uplink,downlink
"""


def levels() -> np.ndarray:
    """Returns the probabilities of the table: evenly spaced, and five a decade in the tails, down to 1e-6."""
    inner = np.linspace(0.0, 1.0, 151)[1:-1]
    tail = np.geomspace(1e-6, inner[0], 21)[:-1]
    exact = np.concatenate(([0.0], tail, inner, 1.0 - tail[::-1], [1.0]))
    return np.array([float(f"{level:.9g}") for level in exact])


def reduced(histogram: QuantileTable) -> QuantileTable:
    """Returns the law that the table keeps; delays to 0.1 us, well below the width of the bins (14 and 38 us)."""
    return QuantileTable(levels(), np.round(histogram.quantile(levels()), 7))


def table_text(uplink: QuantileTable, downlink: QuantileTable) -> str:
    """Returns the two laws as a table."""
    rows = zip(levels(), np.asarray(uplink.delay), np.asarray(downlink.delay), strict=True)
    return HEADER + "".join(f"{level:.9g},{up:.7f},{down:.7f}\n" for level, up, down in rows)


def main() -> None:
    """Reads the histograms, writes the table, and prints how far its CDFs are from theirs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("uplink", type=Path, help="histogram of the uplink delays, XML")
    parser.add_argument("downlink", type=Path, help="histogram of the downlink delays, XML")
    parser.add_argument("table", type=Path, help="CSV file to write")
    args = parser.parse_args()
    histograms = {"uplink": read_histogram(args.uplink), "downlink": read_histogram(args.downlink)}
    laws = {name: reduced(histogram) for name, histogram in histograms.items()}
    args.table.write_text(table_text(**laws), encoding="utf-8")
    for name, histogram in histograms.items():
        edges = np.asarray(histogram.delay)
        difference = np.abs(laws[name].cdf(edges) - histogram.cdf(edges)).max()
        print(f"{name}: largest difference of the CDFs {difference:.1e}")


if __name__ == "__main__":
    main()
