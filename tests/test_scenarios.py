"""The scenarios that come with qocjax: their maps, where robots start and go, and what the stack makes of them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from scipy import ndimage

import qocjax
from experiments.maps import make_maps
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.config.controller import map_of
from qocjax.cost_values import LETHAL
from qocjax.navigation import NavigationStack, check_free, read_map
from qocjax.navigation.maps import StaticMap
from qocjax.scenario import Design, Scenario, num_ticks

ROOT = Path(__file__).parents[1]
MAPS = ROOT / "conf" / "maps"
SCENARIOS = sorted(path.stem for path in (ROOT / "conf" / "scenario").glob("*.yaml"))
ROOMS = {"hall": "hall.yaml", "aisle": "aisle.yaml", "doorway": "doorway.yaml", "junction": "junction.yaml"}
FAR = 4.0  # standard deviations of the jitter that are kept clear around a start
TAU = 0.05  # s


@pytest.fixture(scope="module")
def scenarios() -> Iterator[dict[str, tuple[Scenario, str | None]]]:
    """Each scenario, and the map that it names."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        configs = {name: load(StudyConfig, compose("sweep", [f"scenario={name}"])) for name in SCENARIOS}
    yield {name: (config.build_scenario(), config.scenario.map) for name, config in configs.items()}


def goals(scenario: Scenario) -> np.ndarray:
    return np.broadcast_to(np.asarray(scenario.goal), (scenario.num_robots, 2))


def closed_within(room: StaticMap, radius: float) -> np.ndarray:
    """Nav2's costs of a map whose cells are closed within a radius of obstacles, and free elsewhere."""
    distance = ndimage.distance_transform_edt(room.cost != LETHAL) * room.grid.resolution
    return np.where(distance <= radius, LETHAL, 0) if (room.cost == LETHAL).any() else np.zeros(room.grid.shape)


def test_the_rooms_of_the_paper_the_shop_floor_and_the_fleet_are_there(
    scenarios: dict[str, tuple[Scenario, str | None]],
) -> None:
    assert {"paper", "single", "hall", "crossing", "aisle", "doorway", "junction", "circle8"} <= set(scenarios)
    assert {name: room for name, (_, room) in scenarios.items() if room} == ROOMS
    assert scenarios["circle8"][0].num_robots == 8
    np.testing.assert_array_equal(scenarios["hall"][0].start, scenarios["paper"][0].start)
    different = [name for name, (scenario, _) in scenarios.items() if np.ndim(scenario.goal) == 2]
    assert set(different) == {"crossing", "aisle", "doorway", "junction", "circle8"}
    assert all(scenarios[name][0].reference_per_robot for name in different)


def test_maps_are_what_their_script_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["make_maps.py", str(tmp_path)])
    make_maps.main()
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in MAPS.iterdir()}
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (MAPS / path.name).read_bytes(), path.name


def test_rooms_have_the_sizes_that_they_say() -> None:
    def free(name: str, x: float | None = None, y: float | None = None) -> np.ndarray:
        """Lengths (m) of the free stretches along a line x = ... or y = ..."""
        room = read_map(MAPS / name)
        row, col, _ = room.grid.cell(0.0 if x is None else x, 0.0 if y is None else y)
        line = room.cost[:, int(col)] if x is not None else room.cost[int(row)]
        edges = np.flatnonzero(np.diff(np.r_[0, (line == 0).astype(int), 0]))
        return np.diff(edges)[::2] * room.grid.resolution

    np.testing.assert_allclose(free("doorway.yaml", x=0.0), [0.9])
    np.testing.assert_allclose(free("doorway.yaml", x=1.0), [4.4])
    np.testing.assert_allclose(free("aisle.yaml", x=0.0), [1.4, 1.4])
    np.testing.assert_allclose(free("junction.yaml", x=1.5), [1.2, 1.6, 1.2])
    np.testing.assert_allclose(free("hall.yaml", x=1.0), [5.6])
    np.testing.assert_allclose(free("hall.yaml", y=1.0), [7.0])


@pytest.mark.parametrize("name", SCENARIOS)
def test_starts_and_goals_are_free_with_room_for_the_jitter(
    name: str, scenarios: dict[str, tuple[Scenario, str | None]]
) -> None:
    scenario, room = scenarios[name]
    static_map, radius = map_of(scenario, room), float(np.asarray(scenario.robot_radius))
    reach = radius + FAR * scenario.start_jitter[0]
    start = np.asarray(scenario.start)
    check_free("start", start[:, :2], static_map.grid, closed_within(static_map, reach))
    check_free("goal", goals(scenario), static_map.grid, closed_within(static_map, 2 * radius))
    apart = np.hypot(*(start[:, None, :2] - start[None, :, :2]).transpose(2, 0, 1))
    assert apart[np.triu_indices(len(start), 1)].min(initial=np.inf) > 2 * reach


@pytest.mark.parametrize("name", sorted(ROOMS))
def test_a_way_leads_past_the_walls_to_every_goal(name: str, scenarios: dict[str, tuple[Scenario, str | None]]) -> None:
    scenario, room = scenarios[name]
    static_map = map_of(scenario, room)
    regions, _ = ndimage.label(closed_within(static_map, 1.5 * float(np.asarray(scenario.robot_radius))) == 0)
    places = np.concatenate([np.asarray(scenario.start)[:, :2], goals(scenario)])
    row, col, _ = (np.asarray(each) for each in static_map.grid.cell(*places.T))
    assert len(set(regions[row, col])) == 1 and regions[row[0], col[0]] > 0


def test_the_yardstick_goes_straight_also_through_a_wall(scenarios: dict[str, tuple[Scenario, str | None]]) -> None:
    def blocked(name: str) -> list[bool]:
        scenario, room = scenarios[name]
        static_map = map_of(scenario, room)
        share = np.linspace(0, 1, 2001)[:, None, None]
        way = (1 - share) * np.asarray(scenario.start)[:, :2] + share * goals(scenario)
        row, col, inside = (np.asarray(each) for each in static_map.grid.cell(way[..., 0], way[..., 1]))
        assert inside.all()
        return list((static_map.cost[row, col] == LETHAL).any(axis=0))

    assert blocked("doorway") == [True, True]
    assert not any(blocked("hall") + blocked("aisle") + blocked("junction"))


def run_without_delay(scenario: Scenario, room: str | None) -> tuple[qocjax.Run, StaticMap]:
    static_map = map_of(scenario, room)
    design = Design(tau=TAU, deadline=0.0)
    times = np.zeros((num_ticks(scenario.horizon, TAU), scenario.num_robots))
    return qocjax.simulate(scenario, design, times, controller=NavigationStack(static_map)), static_map


def distance_to_walls(places: np.ndarray, room: StaticMap) -> float:
    """The smallest distance of any place from the square of an obstacle's cell (m)."""
    rows, cols = np.nonzero(room.cost == LETHAL)
    if not rows.size:
        return np.inf
    centres = np.stack(room.grid.point(rows, cols), axis=-1)
    beyond = np.maximum(np.abs(places[:, None] - centres) - room.grid.resolution / 2, 0.0)
    return float(np.sqrt((beyond**2).sum(axis=-1)).min())


def check_arrival(scenario: Scenario, room: str | None) -> None:
    """Every robot stands at its goal, and touched neither another one nor a wall."""
    run, static_map = run_without_delay(scenario, room)
    left = np.hypot(*(np.asarray(run.pose)[-1, :, :2] - goals(scenario)).T)
    assert (left < 0.3).all(), f"left to the goals: {left}"
    assert not bool(run.collided), f"smallest distance {float(run.min_distance):.3f} m"
    assert np.isfinite(np.asarray(run.arrival_time)).all()
    clearance = distance_to_walls(np.asarray(run.pose)[..., :2].reshape(-1, 2), static_map)
    assert clearance > float(np.asarray(scenario.robot_radius)), f"clearance {clearance:.3f} m"


@pytest.mark.slow
def test_the_stack_without_delay_drives_through_the_door(scenarios: dict[str, tuple[Scenario, str | None]]) -> None:
    scenario, room = scenarios["doorway"]
    check_arrival(replace(scenario, horizon=12.0), room)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SCENARIOS if name != "doorway"])
def test_the_stack_without_delay_reaches_every_goal(
    name: str, scenarios: dict[str, tuple[Scenario, str | None]]
) -> None:
    scenario, room = scenarios[name]
    # Eight robots that come to the middle all at once, without jitter, jam there for a while.
    check_arrival(replace(scenario, horizon=45.0) if name == "circle8" else scenario, room)
