"""A page in one file: styles, scripts, data and library inside, and a policy that lets it load nothing else."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from qocjax.report import plotly_js
from qocjax.report.html import escape, json_text
from qocjax.store import write_text

__all__ = ["Section", "details", "facts", "render", "write"]

_SCRIPTS = ("page.js", "charts.js", "replay.js")

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="qocjax">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body>
<a class="skip" href="#main">Skip to the content</a>
<header class="top"><div class="wide">
<div class="heading"><p class="kicker">{kicker}</p><h1>{title}</h1></div>
<button id="theme" type="button" hidden><span aria-hidden="true">◐</span>
<span class="text">Theme: system</span></button>
</div></header>
<nav aria-label="Sections"><div class="wide">{links}</div></nav>
<main id="main" class="wide">
<p id="trouble" class="notice" role="alert" hidden></p>
<noscript><p class="notice">Charts and replay need JavaScript; the tables do not.</p></noscript>
{body}
</main>
<footer class="wide">{footer}</footer>
<script type="application/json" id="data">{data}</script>
<script type="text/plain" id="plotly">{library}</script>
<script>{script}</script>
</body>
</html>
"""


@dataclass(frozen=True)
class Section:
    """A part of a page with its place in the navigation; the content is HTML."""

    id: str
    title: str
    content: str


def write(path: Path, page: str) -> Path:
    """Writes a page, whole or not at all."""
    return write_text(path, page)


def render(
    title: str, kicker: str, lead: str, sections: Sequence[Section], data: Mapping[str, Any], footer: str
) -> str:
    """Puts a page together.

    Args:
        title: Plain text.
        kicker: Plain text above it.
        lead: HTML before the first section.
        sections: What follows.
        data: For the scripts: `charts` by name, `replay`.
        footer: HTML.
    """
    script, style = "\n".join(_asset(name) for name in _SCRIPTS), _asset("page.css")
    body = lead + "".join(
        f'<section id="{escape(each.id)}"><h2>{escape(each.title)}</h2>{each.content}</section>' for each in sections
    )
    links = "".join(f'<a href="#{escape(each.id)}">{escape(each.title)}</a>' for each in sections)
    return _PAGE.format(
        policy=_policy(script), title=escape(title), kicker=escape(kicker), style=style, links=links, body=body,
        footer=footer, data=json_text(data), library=plotly_js.compressed(), script=script,
    )  # fmt: skip


def facts(items: Mapping[str, str]) -> str:
    """Short facts side by side; the values are HTML."""
    rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{value}</dd></div>" for name, value in items.items())
    return f'<dl class="facts">{rows}</dl>'


def details(summary: str, text: str) -> str:
    """Plain text that opens on demand."""
    return f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>"


def _policy(script: str) -> str:
    """Only this script and Plotly may run, and nothing may be loaded from anywhere."""
    own = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    return (
        f"default-src 'none'; script-src 'sha256-{own}' 'sha256-{plotly_js.digest()}'; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'"
    )


def _asset(name: str) -> str:
    return resources.files("qocjax.report").joinpath("assets", name).read_text(encoding="utf-8")
