"""The tables of the page: what was compared on fresh seeds, and what a worse network leaves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from qocjax.advice.advice import Advice
from qocjax.advice.trace_parts import WORST_PART
from qocjax.commands.advice_page.words import GAINS, collisions_text, ms, unless_alone, with_ends
from qocjax.commands.assumed import Given

__all__ = ["arrival_text", "judged_table", "stress_lines", "tie_line"]


def judged_table(advice: Advice, given: Given) -> str:
    """The designs that were compared on fresh seeds."""
    rows = advice.judged
    columns = _columns(rows, "gain", f"gain over {given.own} [95 %]")
    columns[""] = [_named(what, given) for what in rows["what"]]
    columns["there after (s)"] = [arrival_text(row) for row in rows.to_dict("records")]
    return _text(columns)


def stress_lines(advice: Advice, given: Given) -> list[str]:
    """The recommended design on worse networks, and which of them it stands up to."""
    rows = advice.stress
    columns = _columns(rows, "change", "change [95 %]")
    columns[f"QoC of {given.own}"] = ["" if np.isnan(each) else f"{each:.4f}" for each in rows["current_qoc"]]
    columns["stands up"] = rows["stands"].replace("no", "NO")
    asked = advice.target.than("that as it is")
    limit = f", and collisions keep {advice.max_collision_share:.1%} by the upper end of their interval"
    lines = [_text(columns), f"  It stands up where {asked}{unless_alone(advice, limit)}."]
    if WORST_PART in set(rows["what"]):
        lines.append(f"  The {WORST_PART}, of those that judge: found on the fresh seeds, its numbers are of further "
                     "ones; their intervals say how replays of that part differ.")  # fmt: skip
    return lines


def _named(what: str, given: Given) -> str:
    """A design that was compared; `current` only where it was given."""
    gains = what.replace("current gains", given.of_gains)
    return gains if gains != what else what.replace("current", given.design)


def tie_line(ties: pd.DataFrame) -> str:
    """Which of the finalists cannot be told from the recommended design."""
    if len(ties) < 2:
        return "  No other finalist ties with it."
    spans = [f"{name} {ties[name].min():.3g} to {ties[name].max():.3g}" for name in GAINS if np.ptp(ties[name]) > 0]
    spans.append(f"deadline {ms(ties['deadline'].min())} to {ms(ties['deadline'].max())} ms")
    return f"  {len(ties) - 1} other finalist{'s' if len(ties) > 2 else ''} cannot be told from it: " + ", ".join(spans)


def _columns(rows: pd.DataFrame, name: str, title: str) -> dict:
    """The columns that both tables have; of the first row there is no difference."""
    records = rows.to_dict("records")
    return {
        "": rows["what"],
        "deadline (ms)": rows["deadline"].map(ms),
        "AUC (s) [95 %]": [with_ends(row, "auc", ".3g") for row in records],
        "QoC [with J_med's error]": [
            f"{row['qoc']:.4f} [{row['qoc_whole_low']:.4f}, {row['qoc_whole_high']:.4f}]" for row in records
        ],
        title: [with_ends(row, name, "+.4f") if k else "" for k, row in enumerate(records)],
        "loops": rows["completed_share"].map("{:.1%}".format),
        "collisions [95 %]": [collisions_text(row) for row in records],
        "closest (m)": ["-" if np.isinf(each) else f"{each:.2f}" for each in rows["min_distance"]],
    }


def _text(columns: dict) -> str:
    return "\n".join("  " + line for line in pd.DataFrame(columns).to_string(index=False).splitlines())


def arrival_text(row: Mapping[str, Any]) -> str:
    """Mean time until all robots are there; of how many runs, where not of all."""
    if not row["arrived_share"] > 0:
        return "never"
    text = f"{row['arrival_time']:.1f}"
    return text if row["arrived_share"] == 1 else f"{text} ({row['arrived_share']:.1%} of runs)"
