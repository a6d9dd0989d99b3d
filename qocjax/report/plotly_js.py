"""Plotly's JavaScript as it is put into a page: compressed, and unpacked by the browser."""

from __future__ import annotations

import base64
import gzip
import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path

__all__ = ["compressed", "digest"]


@cache
def compressed() -> str:
    """The library, gzip and base64: 2 MB in place of 5."""
    return base64.b64encode(gzip.compress(_library(), 6, mtime=0)).decode("ascii")


@cache
def digest() -> str:
    """SHA-256 of the library in base64, by which the page allows it to run."""
    return base64.b64encode(hashlib.sha256(_library()).digest()).decode("ascii")


@cache
def _library() -> bytes:
    spec = find_spec("plotly")  # its own modules are not needed, and take a while to import
    if spec is None or not spec.submodule_search_locations:
        raise ValueError("report: got no plotly package, expected it installed (pip install plotly), or report=false")
    return (Path(next(iter(spec.submodule_search_locations))) / "package_data" / "plotly.min.js").read_bytes()
