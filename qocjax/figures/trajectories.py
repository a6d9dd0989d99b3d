"""The paths of a run in the plane (paper, "Adopted trajectory for a representative run")."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.colors
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import Normal, Stroke

from qocjax.figures.paths import Paths, RunLike, check_run, closest_approach, travel_time
from qocjax.figures.plane import GOAL, NAMED, Colour, MapLike, colours_of, draw_body, draw_goals, draw_map
from qocjax.figures.quantities import milliseconds
from qocjax.figures.style import GREY, SINGLE_COLUMN, paper_style

__all__ = ["trajectories"]

_NICE = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # s, between time marks
_MARKS = 6  # time marks wanted on the way to the goal


def trajectories(
    run: RunLike,
    *,
    mark_every: float | None = None,
    static_map: MapLike | None = None,
    width: float = SINGLE_COLUMN,
) -> Figure:
    """Draws the robots' paths with marks in time, and close views of the closest approach and the end.

    A robot is its body with an arrow for the heading, in a safety disc of diameter `d_safe`: two safety discs overlap
    exactly when the robots are nearer than `d_safe`, two bodies when they collide. The large panel shows the robots at
    the start and, for the closest approach and the end, where their discs lie (solid and dashed). Paths are thin once
    every robot has come within 2 d_safe of its goal to stay. In the close views the path of the time between two marks
    that led there is heavy. For more robots than there are colours, the shade runs with the robot's number. Goals of
    their own have the colours of their robots.

    Args:
        run: The run.
        mark_every: Seconds between time marks; by default a round number that gives about six.
        static_map: Drawn underneath.
        width: Inches; the height follows from the paths.

    Returns:
        The figure. A single robot has no close views.

    Raises:
        ValueError: An attribute has the wrong shape or is not finite, or `mark_every` is not positive.
    """
    if mark_every is not None and not 0.0 < mark_every < np.inf:
        raise ValueError(f"mark_every: got {mark_every}, expected a positive time in seconds")
    paths = check_run(run)
    colours = colours_of(paths.pose.shape[1])
    every = mark_every or _mark_spacing(paths)
    meeting = closest_approach(paths.pose)
    with paper_style():
        figure, panels = _panels(paths, static_map, width, views=meeting is not None)
        if static_map is not None:
            panels[0].set_adjustable("box")
            for panel in panels:
                draw_map(panel, static_map)
        _draw_overview(panels[0], paths, colours, every, meeting)
        if meeting is not None:
            tick, *pair = meeting
            _draw_view(panels[1], paths, colours, tick, every, pair, "-")
            panels[1].set_title(f"closest, {paths.time[tick]:.3g} s: {_digits(paths.min_distance, 2)} m")
            _draw_view(panels[2], paths, colours, paths.time.size - 1, every, range(len(colours)), "--")
            panels[2].set_title(f"end, {paths.time[-1]:.3g} s")
        _add_legend(figure, paths, colours, every)
    return figure


def _extent(paths: Paths) -> float:
    """Returns how wide a robot is drawn, also where it has no safety disc."""
    return max(paths.d_safe, 3.0 * paths.robot_radius, 0.05)


def _panels(paths: Paths, static_map: MapLike | None, width: float, *, views: bool) -> tuple[Figure, list[Axes]]:
    """Lays out the overview and two square views, below it in one column and beside it in two. Sizes in inches."""
    points = np.concatenate([paths.pose[..., :2].reshape(-1, 2), paths.reference.reshape(-1, 2), paths.goal])
    spread = np.ptp(points, axis=0) + 1.2 * _extent(paths)
    if static_map is not None:
        x_from, x_to, y_from, y_to = static_map.grid.extent
        spread = np.array([x_to - x_from, y_to - y_from])
    ratio = float(np.clip(spread[1] / spread[0], 0.4, 1.4))
    label, title, legend = 0.5, 0.6, 0.55  # room for tick labels at the left, for a title and ticks below, on top
    beside = views and width > 1.5 * SINGLE_COLUMN
    side = (ratio * (width - 2 * label) - title) / (2.0 + ratio) if beside else 0.5 * width - label
    wide = width - 2 * label - side if beside else width - label
    height = ratio * wide + legend + 0.4 + (side + title if views and not beside else 0.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    if not views:
        panels = [figure.add_subplot()]
    elif beside:
        places = figure.add_gridspec(2, 2, width_ratios=(wide, side), hspace=0.12)
        panels = [figure.add_subplot(place) for place in (places[:, 0], places[0, 1], places[1, 1])]
    else:
        places = figure.add_gridspec(2, 2, height_ratios=(ratio * wide, side))
        panels = [figure.add_subplot(place) for place in (places[0, :], places[1, 0], places[1, 1])]
    for index, panel in enumerate(panels):
        panel.set_aspect("equal", adjustable="box" if index else "datalim")
        panel.set_xlabel("" if beside and index == 1 else "$x$ (m)")
        panel.set_ylabel("" if index == 2 and not beside else "$y$ (m)")
    return figure, panels


def _draw_overview(
    panel: Axes, paths: Paths, colours: Sequence[Colour], every: float, meeting: tuple[int, int, int] | None
) -> None:
    """Draws references, goals, whole paths, time marks, and the robots at the start; discs for later instants."""
    many = len(colours) > NAMED
    for path in np.moveaxis(paths.reference, 1, 0):
        panel.plot(*path.T, color=GREY, ls=(0, (4, 2)), lw=0.4 if many else 0.8, zorder=1.5)
    arrived = int(np.searchsorted(paths.time, travel_time(paths)))
    for robot, colour in enumerate(colours):
        x, y = paths.pose[..., robot, :2].T
        panel.plot(x[: arrived + 1], y[: arrived + 1], color=colour, lw=0.5 if many else 1.2, zorder=3)
        panel.plot(x[arrived:], y[arrived:], color=colour, lw=0.25 if many else 0.5, alpha=0.6, zorder=2.5)
        _draw_robot(panel, paths, 0, robot, colour)
        _draw_disc(panel, paths, 0, robot, colour, "-")
        _draw_disc(panel, paths, paths.time.size - 1, robot, colour, "--")
        if meeting is not None and (robot in meeting[1:] or not many):
            _draw_disc(panel, paths, meeting[0], robot, colour, "-")
    draw_goals(panel, paths.goal, colours)
    _draw_marks(panel, paths, colours, every)


def _draw_view(
    panel: Axes, paths: Paths, colours: Sequence[Colour], tick: int, every: float, around: Sequence[int], style: str
) -> None:
    """Draws the robots at one instant, with how they came there, in a window around some of them."""
    since = int(np.searchsorted(paths.time, paths.time[tick] - every))
    many = len(colours) > NAMED
    for robot, colour in enumerate(colours):
        x, y = paths.pose[: tick + 1, robot, :2].T
        panel.plot(x, y, color=colour, lw=0.4, alpha=0.5, zorder=2)
        panel.plot(x[since:], y[since:], color=colour, lw=0.7 if many else 1.2, zorder=3)
        _draw_robot(panel, paths, tick, robot, colour)
        if not many or (robot in around and len(around) == 2):
            _draw_disc(panel, paths, tick, robot, colour, style)
    draw_goals(panel, paths.goal, colours)
    shown = paths.pose[tick, list(around), :2]
    centre = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    reach = 0.5 * float(np.ptp(shown, axis=0).max()) + 0.7 * _extent(paths)
    panel.set_xlim(centre[0] - reach, centre[0] + reach)
    panel.set_ylim(centre[1] - reach, centre[1] + reach)


def _draw_disc(panel: Axes, paths: Paths, tick: int, robot: int, colour: Colour, style: str) -> None:
    fill = matplotlib.colors.to_rgba(colour, 0.1)
    x, y = paths.pose[tick, robot, :2]
    disc = Circle((x, y), 0.5 * paths.d_safe, fc=fill, ec=colour, ls=style, lw=0.7, zorder=2)
    panel.add_patch(disc)


def _draw_robot(panel: Axes, paths: Paths, tick: int, robot: int, colour: Colour) -> None:
    draw_body(panel, paths.pose[tick, robot], paths.robot_radius, colour, 0.5 * _extent(paths))  # to the disc's rim


def _mark_spacing(paths: Paths) -> float:
    span = travel_time(paths) - paths.time[0]
    return next((step for step in _NICE if step * _MARKS >= span), _NICE[-1])


def _draw_marks(panel: Axes, paths: Paths, colours: Sequence[Colour], every: float) -> None:
    """Dots the paths at equal times until all have arrived, with the time beside the first robot's dots."""
    span = travel_time(paths) - paths.time[0]
    times = paths.time[0] + every * np.arange(1, int(span / every + 1e-9) + 1)
    ticks = np.searchsorted(0.5 * (paths.time[1:] + paths.time[:-1]), times)  # the nearest
    size = 2.8 if len(colours) <= NAMED else 1.3
    for robot, colour in enumerate(colours):
        panel.plot(*paths.pose[ticks, robot, :2].T, ls="", marker="o", ms=size, color=colour, mec="w", mew=0.3,
                   zorder=4)  # fmt: skip
    if len(colours) > NAMED:
        return
    taken = [paths.pose[0, 0, :2], *paths.goal]
    # Of the paths, or of a map that is much larger: labels must not meet, and none is better than a heap of them.
    apart = 0.08 * max(
        np.ptp(paths.pose[..., :2], axis=(0, 1)).max(), 0.6 * max(panel.viewLim.width, panel.viewLim.height)
    )
    for tick in ticks:
        x, y, heading = paths.pose[tick, 0]
        if min(np.hypot(*(there - (x, y))) for there in taken) < apart:
            continue
        side = np.array([-np.sin(heading), np.cos(heading)])
        side *= -1.0 if side @ (paths.pose[tick, :, :2].mean(axis=0) - (x, y)) > 0.0 else 1.0  # away from the others
        text = panel.annotate(f"{paths.time[tick]:.4g} s", (x, y), tuple(8 * side), textcoords="offset points",
                              ha="center", va="center", fontsize=6.5, color=colours[0], zorder=7)  # fmt: skip
        text.set_path_effects([Stroke(linewidth=1.5, foreground="w"), Normal()])
        taken.append(np.array([x, y]))


def _add_legend(figure: Figure, paths: Paths, colours: Sequence[Colour], every: float) -> None:
    if len(colours) <= NAMED:
        shade = colours[0]
        texts = [f"robot {number}, AUC {_digits(auc, 3)} s" for number, auc in enumerate(paths.auc, start=1)]
        robots = [Line2D([], [], color=c, lw=1.2, label=text) for c, text in zip(colours, texts, strict=True)]
    else:
        shade = colours[len(colours) // 2]
        text = f"{len(colours)} robots, mean AUC {_digits(paths.auc.mean(), 3)} s"
        robots = [Line2D([], [], color=shade, lw=1.2, label=text)]
    disc = r"safety disc ($d_\mathrm{safe}$)"
    others = [
        Line2D([], [], color=GREY, ls=(0, (4, 2)), lw=0.8, label="reference"),
        Line2D([], [], **GOAL, label="goal"),
        Line2D([], [], ls="", marker="o", ms=2.8, color=shade, label=f"every {every:g} s"),
        Line2D([], [], ls="", marker="o", ms=8, mfc="none", mec=shade, mew=0.7, label=disc),
    ]
    title = None if paths.deadline is None else rf"$\Delta$ = {milliseconds(paths.deadline)} ms"
    figure.legend(handles=robots + others, loc="outside upper center", ncols=3, title=title, handlelength=1.4)


def _digits(number: float, count: int) -> str:
    return f"{number:#.{count}g}".rstrip(".")
