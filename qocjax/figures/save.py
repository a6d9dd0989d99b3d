"""Writing a figure to files."""

from __future__ import annotations

import os
import uuid
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from qocjax.figures.style import paper_style

__all__ = ["save"]

_DPI = 300  # what journals ask of images
_QUICK = {"compress_level": 1}  # a third less time for a PNG that is an eighth larger


def save(figure: Figure, stem: str | Path) -> list[Path]:
    """Writes a figure as `<stem>.png` (300 dpi) and `<stem>.pdf` (fonts embedded as TrueType), making the folder.

    A reader never sees half a file: each is written under another name and then renamed. The PDF carries no date, so
    equal figures give equal files.

    Args:
        figure: What to write.
        stem: Path without the suffix; a dot in it is kept.

    Returns:
        The two paths, PNG first.

    Raises:
        ValueError: `stem` has no file name.
    """
    stem = Path(stem)
    if not stem.name:
        raise ValueError(f"stem: expected a path with a file name, got '{stem}'")
    stem.parent.mkdir(parents=True, exist_ok=True)
    paths = [_write(figure, stem, "png")]
    figure.set_layout_engine("none")  # it is laid out now, and need not be again for the PDF
    return [*paths, _write(figure, stem, "pdf")]


def _write(figure: Figure, stem: Path, kind: str) -> Path:
    path = stem.with_name(f"{stem.name}.{kind}")
    partial = stem.with_name(f".{stem.name}.{uuid.uuid4().hex}.{kind}")
    kinds: dict[str, Any] = {"pdf": {"metadata": {"CreationDate": None}}, "png": {"pil_kwargs": _QUICK}}
    try:
        with paper_style():
            figure.savefig(partial, format=kind, dpi=_DPI, **kinds[kind])
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
    return path
