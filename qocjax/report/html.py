"""Text and numbers on their way into a page: escaped, or in a form that cannot leave the script tag it lies in."""

from __future__ import annotations

import html
import json
import math
from typing import Any

import numpy as np

__all__ = ["escape", "interval", "json_text", "number", "percent", "plus_minus", "signed"]

_ABSENT = "–"
# What could end a script element or begin another one, and line ends that JavaScript once did not take in a string.
_UNSAFE = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def escape(value: object) -> str:
    """Text for the content of an element or for an attribute in quotes, whatever it holds."""
    return html.escape(_encodable(str(value)), quote=True)


def json_text(value: Any) -> str:
    """JSON for a script element: no character in it can end the element; seven digits, null where not finite."""
    text = json.dumps(_plain(value), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for character, safe in _UNSAFE.items():
        text = text.replace(character, safe)
    return text


def number(value: float, form: str = ".4g") -> str:
    """A number in a format, with a true minus sign; a dash where it is not finite."""
    return format(value, form).replace("-", "−") if math.isfinite(value) else _ABSENT


def plus_minus(value: float, error: float, form: str = ".4f") -> str:
    """A mean and its standard error."""
    return f"{number(value, form)} ± {number(error, form)}" if math.isfinite(error) else number(value, form)


def signed(value: float, form: str = ".4f") -> str:
    """A number with its sign."""
    return number(value, f"+{form}")


def interval(low: float, high: float, form: str = "+.4f") -> str:
    """The ends of an interval in brackets."""
    return f"[{number(low, form)}, {number(high, form)}]"


def percent(share: float, form: str = ".3g") -> str:
    """A share in percent."""
    return f"{number(100 * share, form)} %"


def _encodable(text: str) -> str:
    """Names of files may hold bytes that are no text; they are written as such escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _plain(value: Any) -> Any:
    """Arrays, NumPy's numbers and mappings as what JSON knows."""
    if isinstance(value, float):  # first: of a page's 200 000 values nearly all
        return float(f"{value:.7g}") if math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, str):
        return _encodable(value)
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    return value
