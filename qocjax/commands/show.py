"""`python -m qocjax.show`: one run, with its trajectory, an animation and the costmaps of the navigation stack."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np
from omegaconf import DictConfig

from qocjax._room import give_back
from qocjax.commands.command_line import output_dir
from qocjax.config import load
from qocjax.config.show import ShowConfig
from qocjax.controllers import Apf, Cbf, Controller
from qocjax.navigation import NavigationStack, StaticMap, snapshot
from qocjax.single import Run
from qocjax.store import write_config, write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.study.replayed import replay

if TYPE_CHECKING:  # takes as long as JAX to import: while the run is simulated
    from qocjax.figures.costmap import CostmapView
    from qocjax.figures.shown import RunFigures

__all__ = ["Shown", "main", "report", "run"]

_LAWS: dict[type, str] = {Apf: "surrogate law", Cbf: "barrier", NavigationStack: "navigation stack"}

_BEFORE = 1.0  # s before the closest approach, when robots still look for a way past each other


@dataclass(frozen=True)
class Shown:
    """A run and what there is to see of it."""

    run: Run
    static_map: StaticMap | None  # None on open floor
    views: list[CostmapView]  # one for each robot; none of the surrogate law


def run(config: ShowConfig, folder: Path | None = None, drawing: Executor | None = None) -> Shown:
    """Simulates and draws the run of a configuration.

    Args:
        config: What to simulate, and what to draw.
        folder: Where the run, its figures and the record go; None writes nothing.
        drawing: A process that draws half of the figures, from `process_beside`.

    Raises:
        ValueError: A value of the configuration is out of range.
    """
    design, room, controller = config.build_design(), config.build_map(), config.build_controller()
    drawn = folder is not None and config.figures
    looks = drawn or isinstance(controller, NavigationStack)  # whose views are a figure's
    with _imported_meanwhile("qocjax.figures.shown") if looks else nullcontext():
        found = replay(
            config.build_scenario(), design, config.build_network(), config.show.seed,
            rules=config.loop.build(), key=config.key, controller=controller,
        )  # fmt: skip
        done = jax.tree.map(np.asarray, found)
    figures = _begun(done, room, folder / "figures", drawing) if folder and drawn else None
    views = _views(done, controller, config.show.at)
    if figures is not None:
        figures.add_views(views, config.show.robot - 1)
        title = _LAWS.get(type(controller), type(controller).__name__)
        figures.add_film(f"run.{config.show.format}", config.show.fps, config.show.until, title)
    if folder is not None:
        _write(done, config, room, controller, folder)
    if figures is not None:
        figures.finished()
    return Shown(done, room, views)


@contextmanager
def _imported_meanwhile(module: str) -> Iterator[None]:
    """Imports a module on another core than the one that simulates; a part of it that fails does so when it is used."""
    with ThreadPoolExecutor(1) as aside:
        aside.submit(import_module, module)
        yield


def _begun(done: Run, room: StaticMap | None, folder: Path, pool: Executor | None) -> RunFigures:
    """The figures, of which the trajectories are under way."""
    from qocjax.figures.shown import RunFigures

    return RunFigures(done, folder, room, pool)


def _views(done: Run, controller: Controller, at: float | None) -> list[CostmapView]:
    """What every robot's stack looked at, at the sampling instant at or before a time; nothing of the surrogate law."""
    if not isinstance(controller, NavigationStack):
        return []
    from qocjax.figures.paths import check_run, closest_approach

    time = np.asarray(done.time)[:-1]
    if at is None:
        meeting = closest_approach(check_run(done).pose)
        at = max(float(done.time[meeting[0]]) - _BEFORE, 0.0) if meeting else float(time[time.size // 4])
    tick = int(np.searchsorted(time, at + 1e-3 * time[1], side="right")) - 1  # times are single precision
    return [_view(done, controller, robot, tick) for robot in range(done.pose.shape[1])]


def _view(done: Run, stack: NavigationStack, robot: int, tick: int) -> CostmapView:
    from qocjax.figures.costmap import CostmapView

    seen = snapshot(stack, done, tick, robot)
    rollouts = seen.rollouts
    assert rollouts.x is not None and rollouts.y is not None  # a snapshot records them; for the type checker
    static, obstacles, inflation, total = (each.astype(np.uint8) for each in (*seen.layers, seen.total))
    return CostmapView(
        grid=stack.static_map.grid, static=static, obstacles=obstacles, inflation=inflation, total=total,
        path=seen.path, rollout_x=rollouts.x, rollout_y=rollouts.y, weight=rollouts.weight,
        poses=done.pose[tick], robot=robot, begin=seen.begin,
        goal=seen.goal, robot_radius=float(done.robot_radius), time=float(done.time[tick]),
    )  # fmt: skip


def _write(done: Run, config: ShowConfig, room: StaticMap | None, law: Controller, folder: Path) -> None:
    write_table(folder / "run", done.to_pandas())
    write_config(folder, config.model_dump())
    write_json(folder / "record.json", _numbers(done) | provenance(law))
    if config.bag:
        done.to_bag(folder / "bag", room, law if isinstance(law, NavigationStack) else None)


def _numbers(done: Run) -> dict[str, object]:
    """The metrics of a run as plain numbers; an arrival that is never is null."""
    each = {name: np.asarray(getattr(done, name), float).tolist() for name in ("auc", "path_length", "effort")}
    arrival = [float(time) if np.isfinite(time) else None for time in np.asarray(done.arrival_time)]
    whole = {name: float(getattr(done, name)) for name in ("completed_share", "age_mean", "age_peak", "deadline")}
    distance = float(done.min_distance)
    closest = {"min_distance": distance if np.isfinite(distance) else None, "collided": bool(done.collided)}
    own = {name: np.asarray(values, float).tolist() for name, values in done.report.items()}
    return each | {"arrival_time": arrival} | closest | whole | own


def report(shown: Shown) -> str:
    """The run in a few lines."""
    done = shown.run
    ages = [1e3 * float(age) for age in (done.age_mean, done.age_peak)]
    lines = [
        f"deadline {1e3 * float(done.deadline):g} ms, loops completed {float(done.completed_share):.1%}, "
        f"age {ages[0]:.0f} ms on average and {ages[1]:.0f} ms at most"
    ]
    for robot, (auc, time) in enumerate(zip(done.auc, done.arrival_time, strict=True), start=1):
        arrived = f"near its goal from {time:.1f} s on" if np.isfinite(time) else "does not stay near its goal"
        lines.append(f"robot {robot}: AUC {auc:.3f} s, {arrived}")
    if np.isfinite(done.min_distance):
        lines.append(f"smallest distance {float(done.min_distance):.3f} m" + (": a collision" if done.collided else ""))
    return "\n".join(lines)


def main(cfg: DictConfig, drawing: Executor | None = None) -> None:
    """Command line; `drawing` draws half of the figures."""
    give_back()
    config, folder = load(ShowConfig, cfg), output_dir()
    print(report(run(config, folder, drawing)))
    print(f"The run, its figures and the record are in {folder}")
