"""How results show themselves in notebooks: a title, facts, a table."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["card"]


def card(title: str, facts: Mapping[str, str], table: pd.DataFrame) -> str:
    """A piece of HTML that is readable on light and dark pages; all texts are escaped.

    Args:
        title: What it is.
        facts: By name.
        table: Shown as it is, numbers to four digits.
    """
    listed = "".join(f"<div><b>{escape(name)}</b> {escape(value)}</div>" for name, value in facts.items())
    shown = table.to_html(index=False, border=0, float_format=lambda value: f"{value:.4g}", na_rep="")
    return f"<div><p><b>{escape(title)}</b></p>{listed}{shown}</div>"
