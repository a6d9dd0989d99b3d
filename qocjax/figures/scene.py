"""One frame of a run: robots, safety discs, age of information as colour, and the commands in force."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import matplotlib.cm
import matplotlib.colors
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from qocjax.figures.paths import Paths
from qocjax.figures.plane import GOAL, Colour, MapLike, colours_of, draw_goals, draw_map
from qocjax.figures.quantities import milliseconds
from qocjax.figures.style import GREY, paper_style

__all__ = ["Film", "Scene", "age_scale"]

_AHEAD = 1.0  # s that the drawn commands look ahead
_AGES = "YlOrRd"
_HELD = "0.1"
_SIZE, _DPI = 5.2, 100  # inches of the longer side of the plane, and pixels of an inch


class Film(NamedTuple):
    """A run as checked arrays."""

    paths: Paths
    command: NDArray[np.float64]  # [P, N, 2]
    age: NDArray[np.float64]  # [P, N]
    waiting: NDArray[np.bool_]  # [P, N] whether the first command is still under way
    held: NDArray[np.bool_]  # [P, N] whether no newer command has taken effect since the instant before
    ticks: NDArray[np.int_]  # of the frames


class Scene:
    """The figure: what stands still is drawn once, what moves again for each frame."""

    def __init__(self, film: Film, static_map: MapLike | None, title: str) -> None:
        self.film, self.colours = film, colours_of(film.paths.pose.shape[1])
        self.reach = max(film.paths.d_safe, 4.0 * film.paths.robot_radius) / 2
        self.figure, self.axes = _plane(film.paths, static_map, self.reach)
        self.canvas = FigureCanvasAgg(self.figure)
        self.scale = age_scale(film)
        self._add_still(title)
        self.robots = [_Robot(self.axes, film.paths, self.reach, colour) for colour in self.colours]
        nothing = np.zeros(len(self.colours))
        self.speed = self.axes.quiver(
            nothing, nothing, nothing, nothing, color=self.colours, angles="xy", scale_units="xy", scale=1,
            units="inches", width=0.022, headwidth=3.6, headlength=4, minlength=0.1, animated=True, zorder=6,
        )  # fmt: skip
        self.clock = self.axes.text(
            0.0, 1.015, "", transform=self.axes.transAxes, va="bottom", fontsize=9, animated=True, zorder=9
        )

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Draws one frame after the other."""
        with paper_style():
            self.canvas.draw()
        still = self.canvas.copy_from_bbox(self.figure.bbox)
        for tick in self.film.ticks:
            self.canvas.restore_region(still)
            for artist in self.at(int(tick)):
                self.axes.draw_artist(artist)
            yield np.array(np.asarray(self.canvas.buffer_rgba())[..., :3])

    def at(self, tick: int) -> list[Artist]:
        """Moves everything to a sampling instant; what is to be drawn, lowest first."""
        film, now = self.film, min(tick, len(self.film.age) - 1)
        pose, command = film.paths.pose[tick], film.command[now]
        for number, robot in enumerate(self.robots):
            red, green, blue, _ = np.asarray(self.scale.to_rgba(film.age[now, number : number + 1]))[0].tolist()
            held = bool(film.held[now, number])
            robot.move(film.paths.pose[: tick + 1, number], command[number, 1], (red, green, blue, 1.0), held)
        ahead, left = _AHEAD * command[:, 0], _AHEAD * command[:, 2] if command.shape[1] == 3 else 0.0
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        self.speed.set_offsets(pose[:, :2])
        self.speed.set_UVC(ahead * cos - left * sin, ahead * sin + left * cos)
        self.clock.set_text(f"{film.paths.time[tick]:.1f} s")
        layers = zip(*(robot.artists for robot in self.robots), strict=True)
        return [*(artist for layer in layers for artist in layer), self.speed, self.clock]

    def _add_still(self, title: str) -> None:
        paths = self.film.paths
        for reference in np.moveaxis(paths.reference, 1, 0):
            self.axes.plot(*reference.T, color=GREY, ls=(0, (4, 2)), lw=0.8, zorder=1.5)
        draw_goals(self.axes, paths.goal, self.colours)
        bar = self.figure.colorbar(self.scale, ax=self.axes, pad=0.015, aspect=35, extend="both")
        bar.set_label("age of information (ms)")
        bar.ax.yaxis.set_major_formatter(lambda value, _: f"{1e3 * value:g}")
        deadline = None if paths.deadline is None else rf"$\Delta$ = {milliseconds(paths.deadline)} ms"
        heading = ", ".join(text for text in (title, deadline) if text)
        self.figure.legend(handles=_handles(self.colours[0]), loc="outside upper center", ncols=6, title=heading,
                           columnspacing=1.0, handletextpad=0.4)  # fmt: skip


class _Robot:
    """One robot: its trail, safety disc, body, heading, rate of turn, and the ring of a command that is held."""

    def __init__(self, axes: Axes, paths: Paths, reach: float, colour: Colour) -> None:
        self.radius, self.reach = paths.robot_radius, reach
        (self.trail,) = axes.plot([], [], color=colour, lw=1.0, alpha=0.7, animated=True, zorder=3)
        fill = (*matplotlib.colors.to_rgb(colour), 0.12)
        self.disc = Circle((0, 0), paths.d_safe / 2, fc=fill, ec=colour, lw=0.7, animated=True, zorder=2)
        self.body = Circle((0, 0), paths.robot_radius, ec=colour, lw=1.4, animated=True, zorder=4)
        self.ring = Circle((0, 0), 1.45 * paths.robot_radius, fc="none", ec=_HELD, lw=1.2, animated=True, zorder=5)
        (self.nose,) = axes.plot([], [], color=colour, lw=1.6, animated=True, solid_capstyle="butt", zorder=5)
        (self.turn,) = axes.plot([], [], color=colour, lw=1.4, animated=True, zorder=5)
        (self.tip,) = axes.plot([], [], color=colour, ls="", marker="o", ms=2.6, animated=True, zorder=5)
        for patch in (self.disc, self.body, self.ring):
            axes.add_patch(patch)
        self.artists: list[Artist] = [self.trail, self.disc, self.body, self.nose, self.turn, self.tip, self.ring]

    def move(self, poses: NDArray[np.float64], omega: float, fill: Colour, held: bool) -> None:
        """Puts the robot where the poses end, [k, 3]."""
        x, y, heading = poses[-1]
        step = max(1, len(poses) // 400)
        self.trail.set_data(np.append(poses[::step, 0], x), np.append(poses[::step, 1], y))
        for patch in (self.disc, self.body, self.ring):
            patch.set_center((x, y))
        self.body.set_facecolor(fill)
        self.ring.set_visible(held)
        self.nose.set_data([x, x + self.radius * np.cos(heading)], [y, y + self.radius * np.sin(heading)])
        angles = heading + np.linspace(0.0, np.clip(_AHEAD * omega, -np.pi, np.pi), 16)
        arc = np.stack([x + self.reach * np.cos(angles), y + self.reach * np.sin(angles)])
        self.turn.set_data(*arc)
        self.tip.set_data(*arc[:, -1:])


def _plane(paths: Paths, static_map: MapLike | None, reach: float) -> tuple[Figure, Axes]:
    """Lays out the plane; width and height in pixels are even, as films want them."""
    points = np.concatenate([paths.pose[..., :2].reshape(-1, 2), paths.reference.reshape(-1, 2), paths.goal])
    low, high = points.min(axis=0) - 1.2 * reach, points.max(axis=0) + 1.2 * reach
    if static_map is not None:
        x_from, x_to, y_from, y_to = static_map.grid.extent
        low, high = np.minimum(low, (x_from, y_from)), np.maximum(high, (x_to, y_to))
    spread = high - low
    plane = _SIZE * spread / spread.max()
    size = np.maximum(plane, (4.6, 2.0)) + (1.1, 1.15)
    figure = Figure(figsize=tuple(2 * np.round(_DPI * size / 2) / _DPI), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    if static_map is not None:
        draw_map(axes, static_map)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="$x$ (m)", ylabel="$y$ (m)")
    return figure, axes


def age_scale(film: Film) -> matplotlib.cm.ScalarMappable:
    """The ages of what is shown, without those before the first command takes effect and the oldest hundredth."""
    until = film.ticks[-1] + 1
    shown = film.age[:until][~film.waiting[:until]]
    low, high = np.percentile(shown, [0, 99]) if shown.size else (0.0, float(film.age.max()))
    return matplotlib.cm.ScalarMappable(Normalize(low, max(high, low + 0.02)), _AGES)


def _handles(colour: Colour) -> list[Line2D]:
    disc = r"safety disc ($d_\mathrm{safe}$)"
    return [
        Line2D([], [], color=GREY, ls=(0, (4, 2)), lw=0.8, label="reference"),
        Line2D([], [], **GOAL, label="goal"),
        Line2D([], [], ls="", marker="o", ms=9, mfc="none", mec=colour, mew=0.7, label=disc),
        Line2D([], [], color=colour, lw=1.6, marker=">", markevery=(1, 2), ms=4, label=r"$\nu$ in 1 s"),
        Line2D([], [], color=colour, lw=1.4, marker="o", markevery=(1, 2), ms=2.6, label=r"$\omega$ in 1 s"),
        Line2D([], [], ls="", marker="o", ms=6, mfc="none", mec=_HELD, mew=1.2, label="command held"),
    ]
