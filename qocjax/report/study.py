"""The report of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qocjax.figures.tables import present_sweeps
from qocjax.quality import QocScale
from qocjax.report.charts import series_style
from qocjax.report.delays import Completion, completion_words, delay_chart, delay_facts, late_chart
from qocjax.report.hall import HallMap
from qocjax.report.html import escape, interval, number, percent
from qocjax.report.page import Section, details, facts, render, write
from qocjax.report.parts import chart_place, tabs
from qocjax.report.planes import best_chart, plane_chart
from qocjax.report.policies import headline, limit_notes, policies_table
from qocjax.report.replay import Replay, replay_data
from qocjax.report.stages import replay_html
from qocjax.report.sweeps import auc_chart, auc_legend, qoc_chart
from qocjax.study.axes import is_joint
from qocjax.study.hanging import Hanging
from qocjax.study.ties import tie_lines

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["StudyPage", "write_study_report"]


@dataclass(frozen=True)
class StudyPage:
    """What the report of a study is made of; a file per study comes of it and nothing is simulated for it."""

    name: str  # of the study, as a reader knows it
    results: pd.DataFrame
    policies: pd.DataFrame
    scale: QocScale
    network: str  # its name
    completion: Sequence[Completion]  # F over the deadline, that of the usual sampling period first
    about: Mapping[str, str] = field(default_factory=dict)  # further facts, plain text
    config: str = ""  # all options, as text
    record: str = ""  # versions, device
    replays: Sequence[Replay] = ()
    seed: int | None = None  # of the replays
    hall: HallMap | None = None
    failures: Mapping[str, str] = field(default_factory=dict)  # why a part of the study has no results
    limit: float | None = None  # largest share of runs with a collision
    baseline: Mapping[str, float] | None = None  # values by parameter, around which they are swept
    hanging: Hanging = Hanging()  # conclusions of the paper that hang on a choice


def write_study_report(path: Path, page: StudyPage) -> Path:
    """Writes the report of a study as one HTML file that needs nothing else.

    Args:
        path: Where it goes.
        page: What it shows.

    Returns:
        The file.
    """
    sweeps = present_sweeps(page.results)
    charts: dict[str, Any] = {
        "delay": delay_chart(page.completion, page.policies),
        "late": late_chart(page.completion, page.policies),
    }
    for sweep in sweeps:
        if is_joint(sweep):
            charts[f"qoc-{sweep}"] = plane_chart(page.results, page.policies, sweep)
            charts[f"auc-{sweep}"] = best_chart(page.results, sweep)
        else:
            charts[f"qoc-{sweep}"] = qoc_chart(page.results, page.policies, sweep, page.limit, page.baseline)
            charts[f"auc-{sweep}"] = auc_chart(page.results, sweep, page.baseline)
    sections = [
        Section("policies", "Policies", _policies(page)),
        Section("sweeps", "Sweeps", _sweeps(page, sweeps)),
        Section("delays", "Loop times", _delays(page)),
    ]
    data: dict[str, Any] = {"charts": charts}
    if page.replays:
        data["replay"] = replay_data(page.replays, page.hall)
        text = (
            f"Runs of what each policy chose, all with the same start and the same loop times: seed {page.seed}, whose "
            "AUC is the median under the choice shown first."
        )
        sections.append(Section("replay", "Replay", replay_html(page.replays, text)))
    if page.config or page.record:
        parts = [
            details(head, text) for head, text in (("All options", page.config), ("Versions", page.record)) if text
        ]
        sections.append(Section("setup", "Set-up", "".join(parts)))
    return write(path, render(
        page.name, "Quality of control study", headline(page.policies) + _faults(page) + _facts(page), sections, data,
        _FOOTER,
    ))  # fmt: skip


_FOOTER = (
    "<p>QoC is 1 / (1 + min(<i>J</i><sub>max</sub>, <i>J</i>) / <i>J</i><sub>med</sub>), where AUC <i>J</i> is the "
    "squared distance from the reference over time, relative to its initial value. It means nothing without "
    "<i>J</i><sub>med</sub> and <i>J</i><sub>max</sub>, and cannot be compared with that of another study: "
    "<code>python -m qocjax.compare</code> puts several on one scale. Written by qocjax.</p>"
)


def _faults(page: StudyPage) -> str:
    """What has no results, or diverged."""
    lines = [f"{len(page.failures)} chunks failed: {escape('; '.join(sorted(set(page.failures.values()))))}."]
    lines = lines if page.failures else []
    diverged = page.results[page.results["diverged_share"] > 0]
    if len(diverged):
        lines.append(f"{len(diverged)} of {len(page.results)} designs diverged in some run, and were not chosen.")
    return "".join(f'<p class="notice">{line}</p>' for line in lines)


def _facts(page: StudyPage) -> str:
    scale, count = page.scale, page.results["sweep"].nunique()
    items = {
        "Network": escape(page.network),
        "J_med, J_max": f"{_known_to(scale)} s, {number(scale.largest)} s",
        "Seeds": f"{int(page.results['seeds'].iloc[0])} to choose, {int(page.policies['seeds'].iloc[0])} to judge",
        "Designs": f"{len(page.results)} in {count} sweep{'s' if count > 1 else ''}",
    }
    return facts(items | {name: escape(value) for name, value in page.about.items()})


def _known_to(scale: QocScale) -> str:
    return number(scale.median) if not scale.median_se else f"{number(scale.median)} ± {number(scale.median_se, '.2g')}"


def _policies(page: StudyPage) -> str:
    return (
        "<p>Each policy chose value and deadline on some seeds; QoC and AUC are those on others, on which all policies "
        "met the same starts and loop times, so that differences are paired.</p>"
        + _two_intervals(page)
        + policies_table(page.policies)
        + limit_notes(page.policies)
        + _ties(page)
        + _hanging(page.hanging)
    )


def _ties(page: StudyPage) -> str:
    """What the policies could as well have chosen."""
    lines = tie_lines(page.policies) if "tied_values" in page.policies else []
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return (
        "<p>The seeds of the choice cannot tell these values from Co-design's, each at its best deadline (95 % "
        f"interval of the paired difference); of equals the largest mean is taken.</p><ul>{items}</ul>"
    )


def _two_intervals(page: StudyPage) -> str:
    """How much wider intervals are with what is not known of the scale."""
    table = page.policies[page.policies["qoc"].notna()]
    if not page.scale.median_se or "qoc_whole_se" not in table or table.empty:
        return ""
    row = table.loc[table["qoc"].idxmax()]
    return (
        "<p>Intervals are given the scale of this study. Its J_med is an estimate too, and moves all QoC together: "
        f"with its error in it the best QoC, {number(row['qoc'], '.4f')}, is known to "
        f"{interval(row['qoc_whole_low'], row['qoc_whole_high'], '.4f')} instead of "
        f"{interval(row['qoc_low'], row['qoc_high'], '.4f')} (columns <code>qoc_whole_low</code> and "
        "<code>qoc_whole_high</code> of <code>policies.csv</code>). <code>sweep.scale=paper</code>, or an earlier "
        "study, fixes it.</p>"
    )


def _hanging(hanging: Hanging) -> str:
    """Which conclusions hang on a choice of the configuration, with the numbers on demand."""
    if not hanging.text:
        return ""
    lines = []
    for choice, each in groupby(hanging.numbers, key=lambda line: line[1]):
        lines += [f"Not as with the default with {choice}:", *(f"  {claim}. {number}" for claim, _, number in each)]
    numbers = details("The numbers: each choice changed alone, differences with 95 % intervals", "\n".join(lines))
    return f"<p>{escape(hanging.text)}</p>{numbers}"


def _sweeps(page: StudyPage, sweeps: Sequence[str]) -> str:
    results = page.results
    panels = {sweep: _panel(page, sweep) for sweep in sweeps}
    lines = [sweep for sweep in sweeps if not is_joint(sweep)]
    counts = {int(results.loc[results["sweep"] == sweep, "value"].nunique()) for sweep in lines}
    style = "".join(series_style(count) for count in sorted(counts))
    return (
        f"<style>{style}</style><p>QoC and AUC of every design on the seeds of the choice. The marks are the policies' "
        "choices (star Co-design, circle MinDelay, square MaxRel), the baseline's value is bold, bands are one "
        f"standard error.{_collision_words(page.limit)}</p>{tabs(panels)}"
    )


def _panel(page: StudyPage, sweep: str) -> str:
    """The two charts of a sweep."""
    if is_joint(sweep):
        names = ("QoC over two parameters", "QoC of the best combination")
        return (f'<div class="pair">{chart_place(f"qoc-{sweep}", names[0])}'
                f"{chart_place(f'auc-{sweep}', names[1])}</div>")  # fmt: skip
    legend = auc_legend(page.results, sweep, page.baseline)
    return (
        f'<div class="pair">{chart_place(f"qoc-{sweep}", "QoC over deadline and value", keys=True)}'
        f"{chart_place(f'auc-{sweep}', 'AUC over the deadline', after=legend)}</div>"
    )


def _collision_words(limit: float | None) -> str:
    if limit is None:
        return ""
    return (f" Crosses: more than {percent(limit)} of the runs collide, by the lower end of the 95 % interval; dots: "
            "some collide, and the upper end is above.")  # fmt: skip


def _delays(page: StudyPage) -> str:
    return (
        f"<p>How many loops complete within a deadline, on the network {escape(page.network)}, and the deadlines that "
        f"the policies chose.{completion_words(page.completion)}</p>{facts(delay_facts(page.completion[0]))}"
        f'<div class="pair">{chart_place("delay", "Loop completion over the deadline")}'
        f"{chart_place('late', 'Loops that take longer')}</div>"
    )
