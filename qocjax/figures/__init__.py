"""Figures for papers: tables in, matplotlib figures out. Nothing here simulates.

Every function returns a `matplotlib.figure.Figure` that belongs to no window system, so it works in a batch job and in
threads, and leaves the global matplotlib settings as they were. `save` writes it as PNG and PDF.
"""

from qocjax.figures.animation import animate
from qocjax.figures.auc_deadline import auc_against_deadline
from qocjax.figures.costmap import CostmapView, costmap_layers_figure, costmaps
from qocjax.figures.paths import RunLike
from qocjax.figures.policy_bars import policy_bars
from qocjax.figures.qoc_map import qoc_map
from qocjax.figures.save import save
from qocjax.figures.style import DOUBLE_COLUMN, SINGLE_COLUMN, paper_style
from qocjax.figures.trajectories import trajectories

__all__ = [
    "DOUBLE_COLUMN",
    "SINGLE_COLUMN",
    "CostmapView",
    "RunLike",
    "animate",
    "auc_against_deadline",
    "costmap_layers_figure",
    "costmaps",
    "paper_style",
    "policy_bars",
    "qoc_map",
    "save",
    "trajectories",
]
