"""A run as a film: which instants are shown, and which commands are held."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from qocjax.figures.film import write_film
from qocjax.figures.paths import Paths, RunLike, check_run, travel_time
from qocjax.figures.plane import MapLike
from qocjax.figures.scene import Film, Scene
from qocjax.figures.style import paper_style

__all__ = ["MovingRun", "animate", "film_of", "frames"]

_AFTER = 3.0  # s shown after all have arrived


class MovingRun(RunLike, Protocol):
    """What a run must offer to be animated. P ticks, N robots."""

    @property
    def command(self) -> ArrayLike:
        """[P, N, 2] m/s ahead, rad/s, in force at each sampling instant; [P, N, 3] with m/s to the left."""

    @property
    def age(self) -> ArrayLike:
        """[P, N] s, age of information at each sampling instant."""


def animate(
    run: MovingRun,
    path: str | Path,
    *,
    static_map: MapLike | None = None,
    fps: float = 10.0,
    until: float | None = None,
    title: str = "",
) -> Path:
    """Writes a run as an animation in real time.

    Each robot is its body, filled with the colour of its age of information, in a safety disc of diameter `d_safe`.
    An arrow is the speed in force and an arc the rate of turn: how far either goes in one second. A black ring marks a
    command that is held: no newer one has taken effect since the sampling instant before.

    Args:
        run: The run.
        path: Where it goes: `.gif`, or `.mp4` where ffmpeg is installed.
        static_map: Drawn underneath.
        fps: Frames per second.
        until: When it ends (s); by default 3 s after all robots have come within 2 d_safe of their goals to stay, or
            with the run.
        title: Written above, with the deadline.

    Returns:
        The path.

    Raises:
        ValueError: An attribute of the run has the wrong shape or is not finite, a time or rate is not positive, the
            suffix is another, or there is no ffmpeg for an MP4.
    """
    return write_film(frames(run, static_map=static_map, fps=fps, until=until, title=title), Path(path), fps)


def frames(
    run: MovingRun,
    *,
    static_map: MapLike | None = None,
    fps: float = 10.0,
    until: float | None = None,
    title: str = "",
) -> Iterator[NDArray[np.uint8]]:
    """The frames of an animation, [height, width, 3] each; arguments and errors are those of `animate`."""
    film = film_of(run, fps, until)
    with paper_style():
        scene = Scene(film, static_map, title)
    return scene.frames()


def film_of(run: MovingRun, fps: float = 10.0, until: float | None = None) -> Film:
    """The run as checked arrays, with the instants of the frames; arguments and errors are those of `animate`."""
    for name, number in (("fps", fps), ("until", until)):
        if number is not None and not 0.0 < number < np.inf:
            raise ValueError(f"{name}: got {number}, expected a positive number")
    paths = check_run(run)
    periods, robots = paths.time.size - 1, paths.pose.shape[1]
    command, age = np.asarray(run.command, float), np.asarray(run.age, float)
    ways = 3 if command.shape[-1:] == (3,) else 2
    for name, value, shape in (("command", command, (periods, robots, ways)), ("age", age, (periods, robots))):
        if value.shape != shape:
            raise ValueError(f"{name}: got shape {value.shape}, expected {shape}")
        if not np.isfinite(value).all():
            raise ValueError(f"{name}: got {value[~np.isfinite(value)].flat[0]}, expected finite numbers")
    waiting, held = _without_new(paths, age)
    end = min(until or travel_time(paths) + _AFTER, paths.time[-1])
    instants = np.append(np.arange(paths.time[0], end - 0.5 / fps, 1.0 / fps), end)
    ticks = np.searchsorted(0.5 * (paths.time[1:] + paths.time[:-1]), instants)
    return Film(paths, command, age, waiting, held, ticks)


def _without_new(paths: Paths, age: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether a robot waits for its first command, and whether it holds an old one at an instant, each [P, N].

    The age counts from the first instant until a newer command is in force. By then only the deadline tells whether the
    first one is: it is due a deadline after the first instant.
    """
    half = 0.5 * np.diff(paths.time)[:, None]
    since = (paths.time[:-1] - paths.time[0])[:, None]
    tau = paths.time[1] - paths.time[0]
    due = 0.0 if paths.deadline is None else tau * np.ceil(paths.deadline / tau - 1e-3)
    older = np.concatenate([np.zeros((1, age.shape[1]), bool), np.diff(age, axis=0) > half[1:]])
    first = age > since - half
    return first & (since < due - half), older & (~first | (since > due + half))
