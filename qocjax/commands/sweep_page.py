"""What a terminal shows of a study: the policies' table, ties, limits, and what the numbers are relative to."""

from __future__ import annotations

import textwrap
from typing import Any

import pandas as pd

from qocjax.config.study import StudyConfig
from qocjax.network import Network
from qocjax.statistics.collisions import is_alone
from qocjax.statistics.scales import scale_text
from qocjax.statistics.units import study_remark
from qocjax.study import Study
from qocjax.study.axes import value_words
from qocjax.study.choosing import least_seeds, moved_by_limit
from qocjax.study.edges import edges_text
from qocjax.study.reliability import share_text
from qocjax.study.ties import tie_lines

__all__ = ["collisions_text", "diverged_text", "limit_lines", "page", "policy_text"]


def page(study: Study, config: StudyConfig, network: Network, computations: str) -> str:
    """All of it.

    Args:
        study: What was found.
        config: Its options.
        network: Where loop times came from.
        computations: How many computations the edge has under way at once, in a sentence.
    """
    lines = [policy_text(study.policies), *limit_lines(study.policies, config.max_collision_share)]
    if text := diverged_text(study.results):
        lines += ["", text]
    if ties := tie_lines(study.policies):
        lines += ["", "Not told apart by the seeds of the choice, of which Co-design takes the largest mean:"]
        lines += [f"  {line}" for line in ties]
    lines += ["", computations, scale_text(study.scale, "given" if config.scale() else "of this study", columns=True)]
    if remark := study_remark(network, study.policies, config.scenario.horizon, study.results["tau"]):
        lines.append(f"note: {remark}")
    return "\n".join(lines)


def policy_text(policies: pd.DataFrame) -> str:
    """The policies' table for a terminal; choices at an end of what was tried have a star."""
    deadline = policies["at_edge"].str.endswith("deadline")
    value = policies["at_edge"].str.contains(",") | (policies["at_edge"].ne("") & ~deadline)
    words = pd.Series([value_words(row) for row in policies.to_dict("records")], policies.index)
    stars = [each.map({True: "*", False: " "}) for each in (value, deadline)]
    table = pd.DataFrame(
        {
            "sweep": policies["sweep"],
            "policy": policies["policy"],
            "value": words + stars[0],
            "Δ (ms)": (policies["deadline"] * 1e3).map("{:g}".format) + stars[1],
            "F(Δ)": [*map(share_text, policies["reliability"], policies["reliability_se"])],
            "QoC ± SE (J_med's)": [
                f"{text} ({error:.4f})"
                for text, error in zip(_plus_minus(policies, "qoc", 4), policies["qoc_whole_se"], strict=True)
            ],
            "to Co-design [95 %]": [
                "" if row.policy == "Co-design"
                else f"{row.difference:+.4f} [{row.difference_low:+.4f}, {row.difference_high:+.4f}]"
                for row in policies.itertuples()
            ],
            "AUC ± SE (s)": _plus_minus(policies, "auc", 3),
            "collide [95 %]": [collisions_text(row) for row in policies.itertuples()],
        }
    )  # fmt: skip
    if "error" in policies:
        table["error"] = policies["error"]
    table["sweep"] = table["sweep"].where(~table["sweep"].duplicated(), "")
    edges = edges_text(policies)
    return table.to_string(index=False) + "".join(f"\n{line}" for line in textwrap.wrap(f"* {edges}", 118) if edges)


def collisions_text(row: Any) -> str:
    """Share of runs with a collision; `!` where its upper limit breaks what is allowed; of one robot no number."""
    if is_alone(row.collision_high):
        return "one robot "
    low, high = (f"{100 * end:.{1 if end < 0.1 else 0}f}" for end in (row.collision_low, row.collision_high))
    text = f"{row.collision_share:.1%} [{low}, {high}]"
    return text + (" " if row.within_limit else "!")


def limit_lines(policies: pd.DataFrame, limit: float | None) -> list[str]:
    """What the limit on collisions does to the choices, a sentence each.

    Args:
        policies: The table of a study.
        limit: Largest share of runs with a collision; None for none.
    """
    if limit is None:
        return ["No limit on collisions is set (max_collision_share=null): these are the paper's policies."]
    lines = []
    if not policies["within_limit"].all():
        lines.append(f"! not to be driven: fresh seeds do not show that collisions keep within {limit:.0%} of the runs "
                     "(upper 95 % limit).")  # fmt: skip
        seeds = int(policies["seeds"].iloc[0])
        if seeds < (least := least_seeds(limit)):
            lines.append(f"  {seeds} fresh seeds cannot show it, even {least} without a collision just can "
                         "(sweep.evaluation_seeds).")  # fmt: skip
    for row in moved_by_limit(policies).to_dict("records"):
        free = {name.removeprefix("unconstrained_"): each for name, each in row.items() if "unconstrained_" in name}
        lines.append(f"  Without the limit {row['policy']} takes {row['sweep']} = {value_words(row | free)} at "
                     f"{1e3 * free['deadline']:g} ms: QoC {free['qoc']:.4f}, "
                     f"{free['collision_share']:.0%} of the runs collide.")  # fmt: skip
    return lines


def _plus_minus(table: pd.DataFrame, name: str, digits: int) -> list[str]:
    pairs = zip(table[name], table[f"{name}_se"], strict=True)
    return [f"{mean:.{digits}f} ± {error:.{digits}f}" for mean, error in pairs]


def diverged_text(results: pd.DataFrame) -> str:
    """What diverged, a line for each value of a sweep; nothing where nothing did."""
    rows = results[results["diverged_share"] > 0]
    lines = [
        f"  {sweep} = {value_words(part.iloc[0])}: {len(part)} deadlines, in up to {part['diverged_share'].max():.1%} "
        "of the runs"
        for (sweep, _), part in rows.groupby(["sweep", "value"], sort=False)
    ]
    return "\n".join(["Designs that diverged in some run, and are not chosen:", *lines]) if lines else ""
