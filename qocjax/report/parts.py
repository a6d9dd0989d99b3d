"""Parts of pages: the place of a chart, and panels behind tabs, one for each sweep."""

from __future__ import annotations

from collections.abc import Mapping

from qocjax.report.html import escape
from qocjax.report.labels import label, name_of, symbol

__all__ = ["chart_place", "tabs"]


def chart_place(name: str, title: str, *, after: str = "", keys: bool = False) -> str:
    """Where a chart is drawn.

    Args:
        name: Of the chart in the page's data.
        title: Over it; HTML.
        after: HTML below it.
        keys: Whether arrow keys walk over its cells.
    """
    text = f"{title}; arrow keys read out cells" if keys else title
    role = "application" if keys else "img"
    walk = ' tabindex="0" data-keys="1"' if keys else ""
    read = '<p class="readout" aria-live="polite"></p>' if keys else ""
    return (
        f'<figure><figcaption>{title}</figcaption><div class="chart" id="chart-{escape(name)}" '
        f'data-chart="{escape(name)}" role="{role}" aria-label="{text}"{walk}></div>{read}{after}</figure>'
    )


def tabs(panels: Mapping[str, str]) -> str:
    """Panels behind tabs; printed one after the other.

    Args:
        panels: HTML by sweep.
    """
    heads, bodies = [], []
    for k, (sweep, content) in enumerate(panels.items()):
        name = escape(sweep)
        heads.append(
            f'<button type="button" role="tab" id="tab-{name}" aria-controls="panel-{name}" '
            f'aria-selected="{str(k == 0).lower()}" tabindex="{0 if k == 0 else -1}">{symbol(sweep)} '
            f'<span class="words">{name_of(sweep)}</span></button>'
        )
        bodies.append(
            f'<div role="tabpanel" id="panel-{name}" aria-labelledby="tab-{name}"{" class=shown" if k == 0 else ""}>'
            f'<h3 class="printed">{name_of(sweep)} {label(sweep)}</h3>{content}</div>'
        )
    return f'<div role="tablist" aria-label="Sweeps">{"".join(heads)}</div><div class="panels">{"".join(bodies)}</div>'
