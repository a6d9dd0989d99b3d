"""What the charts have in common; colours that follow the theme are set by the style sheet through a trace's name."""

from __future__ import annotations

from typing import Any

import matplotlib
import matplotlib.colors
import numpy as np

from qocjax.figures.style import COLOUR_MAP

__all__ = ["axis", "colour_scale", "colour_style", "layout", "legend_item", "series_style", "series_uid"]

_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def layout(**parts: Any) -> dict[str, Any]:
    """A layout without a background of its own."""
    base: dict[str, Any] = {
        "font": {"family": _FONT, "size": 12},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 62, "r": 14, "t": 34, "b": 48},
        "showlegend": False,
        "hoverlabel": {"bgcolor": "#1b1f24", "bordercolor": "#1b1f24", "align": "left",
                       "font": {"family": _FONT, "size": 12, "color": "#ffffff"}},
        "dragmode": False,
    }  # fmt: skip
    return base | parts


def axis(title: str, **parts: Any) -> dict[str, Any]:
    """An axis with ticks outside and no zero line."""
    return {"title": {"text": title, "standoff": 8}, "ticks": "outside", "ticklen": 4, "zeroline": False,
            "automargin": True, "fixedrange": False} | parts  # fmt: skip


def colour_scale() -> list[list[Any]]:
    """The project's colour map for Plotly."""
    return [[float(at), matplotlib.colors.to_hex(matplotlib.colormaps[COLOUR_MAP](at))] for at in np.linspace(0, 1, 17)]


def series_uid(index: int, count: int) -> str:
    """The name of the k-th of some lines; the style sheet of `series_style` colours what bears it."""
    return f"n{count:02d}c{index:02d}"


def colour_style(uid: str, colour: Any) -> str:
    """Style sheet of a line that has the same colour in every theme; its name begins with `n`."""
    return f".{uid},[class*=trace{uid}]{{--hue:{matplotlib.colors.to_hex(colour)}}}"


def series_style(count: int) -> str:
    """Style sheet of the lines of a chart: from dark to light on paper, from light to dark on a dark screen."""
    light, dark = np.linspace(0.0, 0.9, count), np.linspace(0.98, 0.32, count)
    rules = []
    for k, (on_light, on_dark) in enumerate(zip(light, dark, strict=True)):
        first, other = (matplotlib.colors.to_hex(matplotlib.colormaps[COLOUR_MAP](v)) for v in (on_light, on_dark))
        uid = series_uid(k, count)
        rules.append(f".{uid},[class*=trace{uid}]{{--hue:{first}}}")
        rules.append(f"@supports (color:light-dark(#000,#fff)){{.{uid},[class*=trace{uid}]"
                     f"{{--hue:light-dark({first},{other})}}}}")  # fmt: skip
    return "".join(rules)


def legend_item(uid: str, text: str, *, strong: bool = False) -> str:
    """A button that shows a line's colour and hides the line; `text` is HTML."""
    kind = "swatch strong" if strong else "swatch"
    return (
        f'<button type="button" class="series {uid}" data-series="{uid}" aria-pressed="true">'
        f'<span class="{kind}" aria-hidden="true"></span><span>{text}</span></button>'
    )
