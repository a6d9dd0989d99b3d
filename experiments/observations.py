"""What the paper observes, sentence by sentence in its words, put to the simulation on seeds of its own.

    python experiments/observations.py [--seeds 256] [--out experiments/results]

Writes `observations.csv`, a row for each difference of each sentence on each edge, and the table `observations.md`: for
the edge of the study, which never lets a sample wait, and for one with a worker per robot, whether a sentence holds, is
contradicted, or cannot be tested, and by what numbers. The sentences are in `conclusions.py`, their tests in `claims/`,
what a verdict is in `verdicts.py`. About 80 s.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pandas as pd

from experiments.conclusions import CONCLUSIONS, MODEL, SENTENCES, Conclusion
from experiments.settings import FIRST_SEED, Bench, Setting
from experiments.verdicts import Finding
from qocjax._xla import request_whole_loop
from qocjax.network import Edge

RESULTS = Path(__file__).resolve().parent / "results"
EDGES = {
    "unlimited edge": Setting(),
    "one worker per robot": Setting(edge=Edge(workers=1, discipline="skip")),
}
UNTESTABLE = "cannot be tested"

Found = dict[str, dict[str, Finding]]  # by edge and number


def judged(seeds: int) -> Found:
    """Every sentence that can be tested on each edge."""
    return {
        edge: {each.number: each.judge(bench) for each in CONCLUSIONS}
        for edge, bench in ((edge, Bench(setting, seeds)) for edge, setting in EDGES.items())
    }


def table(found: Found, seeds: int) -> pd.DataFrame:
    """A row for each difference; one for what cannot be tested."""
    rows = []
    for conclusion in (*SENTENCES, *MODEL):
        said = {"number": conclusion.number, "quote": conclusion.quote, "claim": conclusion.claim}
        if isinstance(conclusion.test, str):
            rows.append(said | {"verdict": UNTESTABLE, "note": conclusion.test})
            continue
        for edge, findings in found.items():
            finding = findings[conclusion.number]
            for part in finding.parts:
                interval = part.interval()
                rows.append(said | {
                    "edge": edge, "verdict": finding.verdict, "difference": part.what, "estimate": interval.mean,
                    "low": interval.low, "high": interval.high, "unit": part.unit, "bound": part.bound,
                    "claimed": "above" if part.above else "below", "enough": "one" if finding.some else "all",
                    "side": part.side(), "seeds": seeds, "note": finding.note,
                })  # fmt: skip
    return pd.DataFrame(rows)


def cell(finding: Finding) -> str:
    """A verdict with the differences that decide it."""
    text = "; ".join(part.text() for part in finding.shown)
    of = f" (of {len(finding.parts)})" if len(finding.parts) > len(finding.shown) else ""
    note = f" ({finding.note})" if finding.note else ""
    return f"**{finding.verdict}**{of}: {text}{note}".replace("J*", "J\\*")


def line(conclusion: Conclusion, found: Found) -> str:
    """A row of the page."""
    said = f"“{conclusion.quote}”" if conclusion.quote else conclusion.claim
    if isinstance(conclusion.test, str):
        return f"| {conclusion.number} | {said} | {UNTESTABLE}: {conclusion.test} | |"
    cells = " | ".join(cell(findings[conclusion.number]) for findings in found.values())
    return f"| {conclusion.number} | {said} | {cells} |"


def page(found: Found, seeds: int) -> str:
    """Both tables, as Markdown."""
    head = "|---|---|---|---|"
    edges = " | ".join(edge.capitalize() for edge in found)
    return "\n".join([
        "# The paper's observations, sentence by sentence", "",
        "Made by `python experiments/observations.py`; every difference is in [`observations.csv`](observations.csv). "
        f"Chosen on {seeds // 2} seeds from {2 * FIRST_SEED}, judged on {seeds} from {FIRST_SEED}; differences are "
        "paired, with 95 % intervals; J\\* is the baseline's AUC at its best Δ on that edge. Of several differences "
        "those are shown that decide, one of each unit: the nearest to its bound, or the farthest beyond it.", "",
        f"| | The paper | {edges} |", head, *(line(each, found) for each in SENTENCES), "",
        "What the paper does not say in so many words:", "",
        f"| | | {edges} |", head, *(line(each, found) for each in MODEL), "",
    ])  # fmt: skip


def asked(about: str | None) -> argparse.Namespace:
    """Seeds to judge on, and the folder of the results, of the command line; the folder is made."""
    parser = argparse.ArgumentParser(description=(about or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=256, help="to judge on; half as many others to choose on")
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args()
    if given.seeds < 4:
        parser.error(f"--seeds: got {given.seeds}, expected at least 4")
    given.out.mkdir(parents=True, exist_ok=True)
    return given


def main() -> None:
    """Writes table and page, and prints the page."""
    given = asked(__doc__)
    request_whole_loop()
    found = judged(given.seeds)
    table(found, given.seeds).to_csv(given.out / "observations.csv", index=False, float_format="%.5g")
    text = page(found, given.seeds)
    (given.out / "observations.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
