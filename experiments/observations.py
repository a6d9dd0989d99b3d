"""The paper's observations (model, section 7), each put to the simulation on seeds of its own.

    python experiments/observations.py [seeds]

Prints a Markdown table for the edge of the study, which never lets a sample wait, and for one with a worker per robot:
what the paper observes, what the simulation gives, whether it holds. How each is tested is in `conclusions.py` and
`verdicts.py`. About 40 s.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from experiments.conclusions import CONCLUSIONS, Conclusion
from experiments.settings import FIRST_SEED, Bench, Setting
from experiments.verdicts import Finding
from qocjax._xla import request_whole_loop
from qocjax.network import Edge

_MOST = 3  # differences that are all shown


def row(conclusion: Conclusion, finding: Finding) -> str:
    """A line of the table; of many differences the nearest to its bound."""
    shown = finding.parts if len(finding.parts) <= _MOST else [finding.deciding]
    text = ", ".join(part.text() for part in shown)
    if shown is not finding.parts:
        text = f"of {len(finding.parts)} the nearest to its bound: {text}"
    note = f"; {finding.note}" if finding.note else ""
    return f"| {conclusion.number} | {conclusion.claim} | {text}{note} | {finding.verdict} |"


def main() -> None:
    """Prints the tables."""
    request_whole_loop()
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    print(
        f"Chosen on {seeds // 2} seeds from {2 * FIRST_SEED}, judged on {seeds} from {FIRST_SEED}; differences are "
        "paired, with 95 % intervals; J* is the baseline's AUC at its best deadline."
    )
    one_worker = Setting(edge=Edge(workers=1, discipline="skip"))
    for title, setting in (("Unlimited edge", Setting()), ("One worker per robot, skip", one_worker)):
        bench = Bench(setting, seeds)
        print(f"\n**{title}**\n\n| | The paper observes | The simulation gives | |\n|---|---|---|---|")
        for conclusion in CONCLUSIONS:
            print(row(conclusion, conclusion.judge(bench)), flush=True)


if __name__ == "__main__":
    main()
