"""The policies' choices and how they did, as a table."""

from __future__ import annotations

import pandas as pd

from qocjax.figures.style import POLICIES
from qocjax.report.html import escape, interval, number, percent, plus_minus, signed
from qocjax.report.labels import choice_words, name_of, symbol, value_cell
from qocjax.statistics.collisions import is_alone
from qocjax.study.choosing import moved_by_limit
from qocjax.study.edges import edges_text
from qocjax.study.reliability import share_text

__all__ = ["headline", "limit_notes", "mark", "policies_table"]

_SHAPES = {
    "*": '<path d="M8 .8 9.9 5.7 15.2 6 11.1 9.3 12.5 14.5 8 11.6 3.5 14.5 4.9 9.3 .8 6 6.1 5.7Z"/>',
    "o": '<circle cx="8" cy="8" r="6"/>',
    "s": '<rect x="2.2" y="2.2" width="11.6" height="11.6"/>',
}
_WIDTH = 110  # of the small picture of an interval
_HEADS = (
    "Sweep", "Policy", "Value", "Δ&nbsp;(ms)", "<i>F</i>(Δ)", "QoC ± SE", "95 % interval",
    "Difference to Co-design [95 %]", "AUC ± SE (s)", "QoC when chosen", "Runs too close",
)  # fmt: skip


def mark(policy: str) -> str:
    """A policy's symbol, as in the figures."""
    look = POLICIES.get(policy)
    if look is None:
        return ""
    return f'<svg class="mark" viewBox="0 0 16 16" aria-hidden="true" fill="{look.colour}">{_SHAPES[look.marker]}</svg>'


def policies_table(policies: pd.DataFrame) -> str:
    """A row per sweep and policy, as in `policies.csv`.

    Args:
        policies: The table of a study.
    """
    low, high = float(policies["qoc_low"].min()), float(policies["qoc_high"].max())
    heads = "".join(f'<th scope="col">{head}</th>' for head in _HEADS)
    bodies = [
        "<tbody>" + "".join(_row(row, first == 0, low, high) for first, row in enumerate(rows.to_dict("records")))
        for _, rows in policies.groupby("sweep", sort=False)
    ]
    return (
        '<div class="scroll" role="region" aria-label="Policies of each sweep" tabindex="0">'
        f'<table class="policies"><thead><tr>{heads}</tr></thead>{"".join(bodies)}</table></div>{_edges(policies)}'
    )


def _edges(policies: pd.DataFrame) -> str:
    text = edges_text(policies)
    return f'<p class="edges">* {escape(text)}.</p>' if text else ""


def headline(policies: pd.DataFrame) -> str:
    """The best choice that keeps the limit on collisions in a sentence; a warning where none does."""
    found = policies[(policies["policy"] == "Co-design") & policies["qoc"].notna()]
    joint = found.sort_values("qoc", ascending=False, kind="stable")
    if joint.empty:
        return '<p class="headline"><strong class="warn">No sweep found a design.</strong></p>'
    safe = joint[joint["within_limit"]]
    if safe.empty:
        best = joint.iloc[0]
        warning = (
            f' <strong class="warn">No choice is shown to keep the limit on collisions</strong>: in this one\'s runs '
            f"robots come closer than two radii in {_share(best)}."
        )
        return f'<p class="headline">The best joint choice is {_choice(best)}{_others(policies, best)}.{warning}</p>'
    best = safe.iloc[0]
    text = f"The best joint choice is {_choice(best)}{_others(policies, best)}."
    if best["collision_share"] > 0:
        text += (
            f' <strong class="warn">In {_share(best)} of its runs robots come closer than two radii</strong>: QoC '
            "counts the distance from the reference, not safety."
        )
        calm = joint[joint["collision_share"] == 0]
        if len(calm):
            text += f" The best without such runs is {_choice(calm.iloc[0])}{_others(policies, calm.iloc[0])}."
    return f'<p class="headline">{text}</p>'


def _share(row: pd.Series) -> str:
    return f"{percent(row['collision_share'])} [{percent(row['collision_low'])}, {percent(row['collision_high'])}]"


def limit_notes(policies: pd.DataFrame) -> str:
    """What the limit on collisions changed, and what it leaves without a recommendation."""
    if "unconstrained_qoc" not in policies:
        return "<p>No limit on collisions is set: these are the paper's policies.</p>"
    found = policies[policies["qoc"].notna()]
    text = ""
    if not found["within_limit"].all():
        text = (
            '<p><strong class="warn">Not to be driven</strong> are the rows whose collisions stand out: on fresh seeds '
            "the upper 95 % limit of their share breaks what is allowed (<code>max_collision_share</code>). Where "
            "these seeds do not bear out a policy's safer choice, the row is what it takes without a limit.</p>"
        )
    items = "".join(
        f"<li>{mark(row['policy'])} {escape(row['policy'])}: {choice_words(row, 'unconstrained_')} with Δ = "
        f"{number(1e3 * row['unconstrained_deadline'])} ms, QoC {number(row['unconstrained_qoc'], '.4f')}, too close "
        f"in {percent(row['unconstrained_collision_share'])} of the runs</li>"
        for row in moved_by_limit(found).to_dict("records")
    )
    return text + (f"<p>Without the limit, as in the paper, the policies take:</p><ul>{items}</ul>" if items else "")


def _choice(row: pd.Series) -> str:
    return (
        f"{choice_words(row)} with Δ = "
        f"{number(1e3 * row['deadline'])} ms: QoC <strong>{plus_minus(row['qoc'], row['qoc_se'])}</strong> on fresh "
        "seeds"
    )


def _others(policies: pd.DataFrame, best: pd.Series) -> str:
    """What the other policies reach in the same sweep."""
    rows = policies[(policies["sweep"] == best["sweep"]) & (policies["policy"] != "Co-design")].to_dict("records")
    texts = ", ".join(f"{escape(row['policy'])} {number(row['qoc'], '.4f')}" for row in rows)
    return f" ({texts})" if rows else ""


def _row(row: dict, first: bool, low: float, high: float) -> str:
    sweep, policy = str(row["sweep"]), str(row["policy"])
    name = f'{symbol(sweep)} <span class="words">{name_of(sweep)}</span>' if first else ""
    gap = "" if policy == "Co-design" or pd.isna(row["qoc"]) else (
        f"{signed(row['difference'])} {interval(row['difference_low'], row['difference_high'])}"
    )  # fmt: skip
    alone = is_alone(row["collision_high"])
    close = "one robot" if alone else percent(row["collision_share"])
    close = close if row["within_limit"] else f'<strong class="warn">{close}</strong>'
    if not alone:
        close += (f'<br><small>{percent(row["collision_low"])} to {percent(row["collision_high"])}<br>closest '
                  f"{number(row['min_distance'], '.2f')} m</small>")  # fmt: skip
    if pd.isna(row["qoc"]):
        gap = f'<span class="warn">{escape(row.get("error") or "no design")}</span>'
    edges = {end.split()[-1]: f'<abbr title="{escape(end)} of those tried">*</abbr>'
             for end in row["at_edge"].split(", ") if end}  # fmt: skip
    value = value_cell(row) + "".join(mark for name, mark in edges.items() if name != "deadline")
    deadline = number(1e3 * row["deadline"]) + edges.get("deadline", "")
    cells = (
        name, f"{mark(policy)} {escape(policy)}", value, deadline,
        share_text(row["reliability"], row["reliability_se"]), plus_minus(row["qoc"], row["qoc_se"]),
        _picture(row, low, high), gap, plus_minus(row["auc"], row["auc_se"], ".3f"),
        number(row["qoc_selection"], ".4f"), close,
    )  # fmt: skip
    parts = [
        f'<{"th scope=row" if k == 1 else "td"} data-label="{_plain_head(head)}"{" class=empty" if not cell else ""}>'
        f"{cell}</{'th' if k == 1 else 'td'}>"
        for k, (head, cell) in enumerate(zip(_HEADS, cells, strict=True))
    ]
    return f"<tr>{''.join(parts)}</tr>"


def _plain_head(head: str) -> str:
    return escape(head.replace("<i>", "").replace("</i>", "").replace("&nbsp;", " "))


def _picture(row: dict, low: float, high: float) -> str:
    """The interval as a line with a dot, on one axis for the whole table."""
    if pd.isna(row["qoc"]):
        return ""
    span = (high - low) or 1.0
    left, at, right = (4 + (_WIDTH - 8) * (float(row[name]) - low) / span for name in ("qoc_low", "qoc", "qoc_high"))
    text = interval(row["qoc_low"], row["qoc_high"], ".4f")
    look = POLICIES.get(str(row["policy"]))
    return (
        f'<svg class="whisker" viewBox="0 0 {_WIDTH} 14" role="img" aria-label="{text}"><title>{text}</title>'
        f'<path class="rail" d="M4 7H{_WIDTH - 4}"/><path class="range" d="M{left:.1f} 7H{right:.1f}M{left:.1f} 4v6'
        f'M{right:.1f} 4v6"/><circle cx="{at:.1f}" cy="7" r="3.6" fill="{look.colour if look else "#777"}"/></svg>'
    )
