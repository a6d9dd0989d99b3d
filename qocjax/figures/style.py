"""The look shared by all figures: column widths, fonts, colours that survive colour blindness and a grey printer."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import matplotlib
import numpy as np

__all__ = [
    "COLOUR_MAP",
    "DOUBLE_COLUMN",
    "GREY",
    "OKABE_ITO",
    "POLICIES",
    "SINGLE_COLUMN",
    "Policy",
    "paper_style",
    "sequence",
]

SINGLE_COLUMN = 3.5  # inches, one column of an IEEE two-column page
DOUBLE_COLUMN = 7.16  # inches, both columns
GREY = "0.35"
COLOUR_MAP = "viridis"  # even steps of lightness: reads the same to all eyes and in grey

# Okabe and Ito's palette without its yellow, which is too light on paper, and without black.
OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


@dataclass(frozen=True)
class Policy:
    """How one policy is drawn: a bar's colour and hatch, a point's marker and size."""

    colour: str
    hatch: str
    marker: str
    size: float  # points; nested, so that policies which choose the same point all stay visible


POLICIES = {
    "Co-design": Policy("#0072B2", "", "*", 6.5),
    "MinDelay": Policy("#E69F00", "/////", "o", 7.5),
    "MaxRel": Policy("#A8DCCB", ".....", "s", 9.5),
}

_SETTINGS = {
    "font.family": "STIXGeneral",  # ships with matplotlib, and sits well beside Times
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.title_fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "legend.borderaxespad": 0.3,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 1.0,
    "hatch.linewidth": 0.5,
    "axes.grid": False,
    "axes.unicode_minus": True,
    "figure.constrained_layout.h_pad": 0.02,
    "figure.constrained_layout.w_pad": 0.02,
    "savefig.bbox": "standard",  # "tight" would change the column width
    "pdf.fonttype": 42,  # TrueType: submission systems reject Type 3
    "ps.fonttype": 42,
}

_lock = threading.RLock()


@contextmanager
def paper_style() -> Iterator[None]:
    """Applies the settings of the figures within a `with` block and restores the caller's afterwards.

    One thread at a time: matplotlib's settings are global, so two interleaved blocks would restore each other's.
    """
    with _lock, matplotlib.rc_context():
        matplotlib.rcdefaults()
        cast(Any, matplotlib.rcParams).update(_SETTINGS)
        yield


def sequence(count: int) -> list[tuple[float, float, float, float]]:
    """Returns `count` colours from dark to light, ordered in grey as well (without the map's palest end)."""
    return [(r, g, b, a) for r, g, b, a in matplotlib.colormaps[COLOUR_MAP](np.linspace(0.0, 0.9, count))]
