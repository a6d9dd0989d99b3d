"""Whether what the paper measured of RELIABLE, a QoC 51.5 % above that of BEST_EFFORT, comes out of a study."""

from __future__ import annotations

import pandas as pd

from qocjax.statistics.estimates import student
from qocjax.transport.qos import QosStudy

__all__ = ["MEASURED", "paper_gain_text"]

MEASURED = 51.5
"""Percent of QoC, section V-B: on robots, over a link whose losses the paper does not give."""

_HOLDS = {
    "hold": "leaves the last command in force",
    "zero": "stops the robot",
    "timeout": "leaves the last command in force until a timeout",
    "decay": "lets the last command fade",
    "buffer": "plays on the last plan",
}


def paper_gain_text(study: QosStudy, hold: str) -> str:
    """Says how the largest gain of a study stands to the paper's.

    Each gain is that over the first profile, at deadlines that other seeds chose; all intervals hold together with
    95 %, so that the largest of them may be picked.

    Args:
        study: Its first profile is BEST_EFFORT.
        hold: What a missed loop does, of `Rules`.
    """
    first = study.results["profile"].iloc[0]
    rows = pd.concat([study.best, study.most], ignore_index=True)
    rows = rows[rows["profile"] != first].reset_index(drop=True)
    seeds = int(study.results["seeds"].iloc[0]) // 2
    wider = student(seeds, 1.0 - 0.05 / len(rows)) / student(seeds)
    half = wider * (rows["gain_percent_high"] - rows["gain_percent"])
    low, high = rows["gain_percent"] - half, rows["gain_percent"] + half
    if (low >= MEASURED).any():
        verdict = "comes out here"
    else:
        verdict = "does not come out here" if (high < MEASURED).all() else "is not told from what comes out here"
    k = rows["gain_percent"].idxmax()
    row, kind = rows.loc[k], "in bursts of {:g}" if rows.loc[k, "burst"] > 1 else "independently"
    gain = f"{row['gain_percent']:+.1f} % [{low[k]:+.1f}, {high[k]:+.1f}]"
    where = f"{row['profile']}, {row['loss']:.0%} lost {kind.format(row['burst'])}, {1e3 * row['deadline']:g} ms"
    text = (
        f"The paper's {MEASURED:+} % for RELIABLE {verdict}, where a missed loop {_HOLDS[hold]} (loop.hold={hold}): "
        f"the largest of {len(rows)} gains is {gain}, all intervals together at 95 % ({where})."
    )
    return text if hold == "zero" else f"{text} It can where a missed loop stops the robot (loop.hold=zero)."
