"""All figures of one run, as files."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qocjax.figures.animation import MovingRun, animate
from qocjax.figures.beside import Drawings
from qocjax.figures.costmap import CostmapView, costmap_layers_figure, costmaps
from qocjax.figures.plane import MapLike
from qocjax.figures.save import save
from qocjax.figures.trajectories import trajectories

__all__ = ["RunFigures"]


class RunFigures:
    """The figures of a run. What is known of it first is drawn first, while the rest is worked out."""

    def __init__(self, run: MovingRun, folder: Path, room: MapLike | None = None, pool: Executor | None = None) -> None:
        """Begins with the trajectories.

        Args:
            run: The run.
            folder: Where the files go.
            room: The map, drawn underneath.
            pool: A process that helps, from `process_beside`; it imports nothing that computes.
        """
        self._run, self._folder = _Shown.of(run), folder
        self._room = None if room is None else _Room(_Edges(room.grid.extent), np.asarray(room.cost))
        self._drawings = Drawings(pool)
        self._drawings.add(partial(_draw_trajectories, self._run, self._room, folder / "trajectories"))

    def add_film(self, name: str, fps: float, until: float | None, title: str) -> None:
        """Adds the animation, see `animate`."""
        path = self._folder / name
        self._drawings.add(partial(_write_film, self._run, self._room, path, fps, until, title))

    def add_views(self, views: Sequence[CostmapView], robot: int) -> None:
        """Adds the costmaps of all robots, and one robot's layers; nothing without views.

        Args:
            views: One for each robot.
            robot: Whose layers; from 0.
        """
        views = [replace(view, grid=_Edges(view.grid.extent)) for view in views]
        if views:
            self._drawings.add(partial(_draw_costmaps, views, self._folder / "costmaps"))
            self._drawings.add(partial(_draw_layers, views[robot], self._folder / f"costmap_robot{robot + 1}"))

    def finished(self) -> list[Path]:
        """The files, when all are drawn."""
        return self._drawings.finished()


@dataclass(frozen=True)
class _Shown:
    """What is drawn of a run, without what computed it: a process that only draws can read it."""

    time: NDArray[np.float64]
    pose: NDArray[np.float64]
    command: NDArray[np.float64]
    age: NDArray[np.float64]
    reference: NDArray[np.float64]
    goal: NDArray[np.float64]
    d_safe: NDArray[np.float64]
    robot_radius: NDArray[np.float64]
    deadline: NDArray[np.float64] | None
    auc: NDArray[np.float64]
    min_distance: NDArray[np.float64]

    @classmethod
    def of(cls, run: MovingRun) -> _Shown:
        """Of any run that can be animated."""
        found: dict[str, Any] = {each.name: np.asarray(getattr(run, each.name)) for each in fields(cls)}
        return cls(**found | ({"deadline": None} if run.deadline is None else {}))


@dataclass(frozen=True)
class _Edges:
    extent: tuple[float, float, float, float]


@dataclass(frozen=True)
class _Room:
    grid: _Edges
    cost: NDArray[np.uint8]


def _draw_trajectories(run: _Shown, room: _Room | None, stem: Path) -> list[Path]:
    return save(trajectories(run, static_map=room), stem)


def _write_film(run: _Shown, room: _Room | None, path: Path, fps: float, until: float | None, title: str) -> list[Path]:
    return [animate(run, path, static_map=room, fps=fps, until=until, title=title)]


def _draw_costmaps(views: Sequence[CostmapView], stem: Path) -> list[Path]:
    return save(costmaps(views), stem)


def _draw_layers(view: CostmapView, stem: Path) -> list[Path]:
    return save(costmap_layers_figure(view), stem)
