"""The map: files of ROS, distances against SciPy, Nav2's costs, and what age and uncertainty add to them."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import distance_transform_edt

from qocjax.navigation import (
    Disc,
    Grid,
    Inflation,
    Obstacles,
    Rectangle,
    StaticMap,
    check_free,
    costmap_layers,
    distance_to,
    map_of_shapes,
    others,
    read_map,
    squared_distance,
    static_layer,
)
from qocjax.navigation.costmap import influence
from qocjax.navigation.patches import patched

GRID = Grid(0.05, (-1.0, -0.5), (30, 44))
layers_of = jax.jit(costmap_layers, static_argnames="grid")

YAML = """image: map.pgm
resolution: 0.05
origin: [-1.0, 2.5, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
# Black, dark, the grey that ROS saves for unknown, light, white; the last row of the picture is the first of the map.
PIXELS = np.array([[0, 90, 205, 206, 255], [255, 255, 255, 255, 0]], np.uint8)


def write(folder, text=YAML, pixels=PIXELS, name="map.pgm"):
    Image.fromarray(pixels).save(folder / name)
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"


# Grid


def test_cells_and_points_are_inverse():
    rows, cols = np.meshgrid(*(np.arange(n) for n in GRID.shape), indexing="ij")
    row, col, inside = GRID.cell(*GRID.point(rows, cols))
    np.testing.assert_array_equal(row, rows)
    np.testing.assert_array_equal(col, cols)
    assert bool(inside.all())
    for x, y in ((-1.001, 0.0), (1.2001, 0.0), (0.0, -0.501), (0.0, 1.001), (math.nan, 0.0), (0.0, math.inf)):
        assert not bool(GRID.cell(x, y)[2])


def test_a_grid_covers_a_rectangle_and_is_hashable():
    grid = Grid.covering((-3.0, -3.0), (3.0, 2.96), 0.05)
    assert grid.shape == (120, 120) and hash(grid) == hash(Grid(0.05, (-3.0, -3.0), (120, 120)))
    np.testing.assert_allclose(grid.extent, (-3, 3, -3, 3))


def test_nearest_reads_the_cell():
    x, y = (jnp.asarray(each) for each in GRID.centres())
    plane = 2.0 + 3.0 * x - 4.0 * y + 5.0 * x * y
    batch = jnp.stack([plane, 10.0 * plane])
    rng = np.random.default_rng(1)
    px, py = (jnp.asarray(rng.uniform(low, low + width, (2, 50))) for low, width in ((-0.97, 2.14), (-0.47, 1.44)))
    row, col, _ = GRID.cell(px, py)
    np.testing.assert_array_equal(GRID.nearest(batch, px, py, 254.0), np.asarray(batch)[[[0], [1]], row, col])
    np.testing.assert_array_equal(GRID.nearest(plane, jnp.array([9.0, math.nan]), jnp.zeros(2), 254.0), [254.0, 254.0])


# Distance transform


def test_the_distance_transform_is_that_of_scipy():
    rng = np.random.default_rng(2)
    for shape in ((24, 31), (31, 24), (1, 40), (40, 1)):
        occupied = rng.random((40, *shape)) < np.linspace(0.005, 0.5, 40)[:, None, None]
        occupied[:, 0, 0] = True
        found = np.asarray(jax.jit(squared_distance)(jnp.asarray(occupied)))
        for each, squared in zip(occupied, found, strict=True):
            row, col = distance_transform_edt(~each, return_distances=False, return_indices=True)
            rows, cols = np.indices(shape)
            np.testing.assert_array_equal(squared, (rows - row) ** 2 + (cols - col) ** 2)


def test_without_an_obstacle_the_distance_is_infinite():
    occupied = jnp.zeros((2, 5, 6), bool).at[1, 2, 3].set(True)
    distance = np.asarray(distance_to(occupied, 0.1))
    assert np.isinf(distance[0]).all() and distance[1].max() == pytest.approx(0.1 * math.hypot(2, 3))


# Shapes


def test_a_rectangle_on_the_edges_of_cells_fills_them_and_a_thin_wall_stands():
    box = map_of_shapes(GRID, [Rectangle((0.0, 0.25), (0.4, 0.2))]).cost
    assert (box == 254).sum() == 8 * 4
    x, y = GRID.centres()
    np.testing.assert_array_equal(box == 254, (abs(x) < 0.2) & (abs(y - 0.25) < 0.1))
    thin = map_of_shapes(GRID, [Rectangle((0.013, 0.25), (1e-3, 9.0))]).cost
    assert ((thin == 254).sum(axis=1) == 1).all()
    turned = map_of_shapes(GRID, [Rectangle((0.0, 0.25), (0.2, 0.4), math.pi / 2)]).cost
    np.testing.assert_array_equal(turned, box)


def test_a_disc_has_its_area():
    grid = Grid.covering((-1.0, -1.0), (1.0, 1.0), 0.005)
    area = (map_of_shapes(grid, [Disc((0.1, -0.2), 0.5)]).cost == 254).sum() * 0.005**2
    assert area == pytest.approx(math.pi * 0.5025**2, rel=1e-3)  # grown by half a cell


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Disc((0.0, 0.0), 0.0), "radius of the disc: got 0.0, expected > 0"),
        (lambda: Rectangle((0.0, 0.0), (1.0, -1.0)), "size of the rectangle: got .* expected > 0"),
        (lambda: Grid(0.0, (0.0, 0.0), (2, 2)), "resolution: got 0.0, expected > 0"),
        (lambda: Grid(0.1, (0.0, 0.0), (0, 2)), "shape: got 0, expected at least 1"),
        (lambda: Grid.covering((0.0, 0.0), (1.0, 0.0), 0.1), "high: got .* expected above low"),
        (lambda: StaticMap(GRID, np.zeros((2, 2), int)), r"cost: got shape \(2, 2\), expected \(30, 44\)"),
        (lambda: Inflation(robot_radius=-0.1), "robot_radius: got -0.1, expected >= 0"),
        (lambda: Inflation(inflation_radius=math.inf), "inflation_radius: got inf, expected finite"),
        (lambda: GRID.take(jnp.zeros((3, 30, 44)), jnp.zeros(2, int), jnp.zeros(2, int)), "values: got shape"),
    ],
)
def test_wrong_values_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Files of ROS


@pytest.mark.parametrize("name", ["map.pgm", "map.png"])
def test_a_map_of_ros_is_read_as_the_map_server_reads_it(tmp_path, name):
    read = read_map(write(tmp_path, YAML.replace("map.pgm", name), name=name))
    assert read.grid == Grid(0.05, (-1.0, 2.5), (2, 5))
    # occ = 1, 0.647, 0.1961, 0.192, 0: above 0.65 occupied, below 0.196 free.
    np.testing.assert_array_equal(read.cost, [[0, 0, 0, 0, 254], [254, 255, 255, 0, 0]])


def test_a_plain_pgm_with_comments_and_another_maximum(tmp_path):
    path = write(tmp_path)
    (tmp_path / "map.pgm").write_text("P2\n# made by hand\n3 1\n10\n0 8 10\n")
    np.testing.assert_array_equal(read_map(path).cost, [[254, 255, 0]])


def test_a_raw_pgm_of_sixteen_bits(tmp_path):
    path = write(tmp_path)
    (tmp_path / "map.pgm").write_bytes(b"P5 3 1 65535\n" + np.array([0, 50000, 65535], ">u2").tobytes())
    np.testing.assert_array_equal(read_map(path).cost, [[254, 255, 0]])


def test_negate_turns_dark_and_light(tmp_path):
    np.testing.assert_array_equal(
        read_map(write(tmp_path, YAML.replace("negate: 0", "negate: 1"))).cost,
        read_map(write(tmp_path, pixels=255 - PIXELS)).cost,
    )


def test_mode_scale_spreads_what_is_between(tmp_path):
    for mode in ("trinary", "Trinary", "TRINARY"):  # Nav2 lowers the word
        assert np.array_equal(read_map(write(tmp_path, YAML + f"mode: {mode}\n")).cost, read_map(write(tmp_path)).cost)
    path = write(tmp_path, YAML + "mode: scale\n")
    np.testing.assert_array_equal(read_map(path).cost, [[0, 0, 0, 0, 254], [254, 0, 0, 0, 0]])
    # occ 0.6471 is 99 of 100 between the thresholds, 0.1961 is 0 of 100: 254 · 99 / 100 = 251.46.
    np.testing.assert_array_equal(read_map(path, trinary_costmap=False).cost[1], [254, 251, 0, 0, 0])


def test_what_is_not_opaque_is_unknown(tmp_path):
    pixels = np.array([[[255, 255, 255, 255], [255, 255, 255, 0], [0, 0, 0, 255], [0, 0, 0, 0]]], np.uint8)
    text = YAML.replace("map.pgm", "map.png")
    for mode in ("", "mode: scale\n"):
        path = write(tmp_path, text + mode, pixels, "map.png")
        np.testing.assert_array_equal(read_map(path).cost, [[0, 255, 254, 255]])
    grey = np.array([[[205, 205, 205, 255], [254, 254, 254, 254]]], np.uint8)
    np.testing.assert_array_equal(read_map(write(tmp_path, text, grey, "map.png")).cost, [[255, 255]])


def test_opacity_as_humble_reads_it(tmp_path):
    # Up to Iron it is one more channel in mode trinary: 3/4 of white is occ 0.25, 1/4 is occ 0.75, grey 205 is 0.147.
    pixels = np.array([[[255, 255, 255, 255], [255, 255, 255, 0], [0, 0, 0, 255], [0, 0, 0, 0], [205, 205, 205, 255]]],
                      np.uint8)  # fmt: skip
    path = write(tmp_path, YAML.replace("map.pgm", "map.png"), pixels, "map.png")
    np.testing.assert_array_equal(read_map(path, release="humble").cost, [[0, 255, 254, 254, 0]])
    with pytest.raises(ValueError, match="release: got 'foxy', expected one of jazzy, humble"):
        read_map(path, release="foxy")


def test_colours_count_by_their_luma_since_jazzy(tmp_path):
    pixels = np.array([[[0, 255, 0], [255, 0, 0], [0, 0, 255]]], np.uint8)  # luma 0.587, 0.299, 0.114
    path = write(tmp_path, YAML.replace("map.pgm", "map.png").replace("0.196", "0.45"), pixels, "map.png")
    np.testing.assert_array_equal(read_map(path).cost, [[0, 254, 254]])
    np.testing.assert_array_equal(read_map(path, release="humble").cost, [[254, 254, 254]])  # a third each


def test_mode_raw_is_the_occupancy(tmp_path):
    path = write(tmp_path, YAML + "mode: raw\n", np.array([[0, 50, 100, 101, 255]], np.uint8))
    np.testing.assert_array_equal(read_map(path, trinary_costmap=False).cost, [[0, 127, 254, 255, 255]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("0.05", "-0.05"), "map.yaml, line 2: resolution: got -0.05, expected > 0"),
        (("0.05", "fine"), "map.yaml, line 2: resolution: got 'fine', expected a real number"),
        (("0.0]", "0.5]"), "map.yaml, line 3: origin: got yaw 0.5, expected 0"),
        ((", 0.0]", "]"), r"map.yaml, line 3: origin: got \[-1.0, 2.5\], expected \[x, y, yaw\]"),
        (("negate: 0", "negate: 2"), "map.yaml, line 4: negate: got 2, expected 0 or 1"),
        (("0.65", "1.2"), "map.yaml, line 5: occupied_thresh: got 1.2, expected <= 1"),
        (("0.65", "0.1"), "map.yaml, line 6: free_thresh: got 0.196, expected below occupied_thresh, 0.1"),
        (("free_thresh: 0.196", "mode: fuzzy\nfree_thresh: 0.1"), "line 6: mode: got 'fuzzy', expected one of trinary"),
        (("free_thresh: 0.196", ""), "map.yaml: has no free_thresh, expected image"),
        (("map.pgm", "other.pgm"), "map.yaml, line 1: image: found no file .*other.pgm"),
        (("map.pgm", "7"), "map.yaml, line 1: image: got 7, expected the name of a file"),
        (("[-1.0", "[-1.0, ["), "map.yaml, line .*: is no YAML: "),
        ((YAML, "a map"), "map.yaml: expected lines such as"),
        ((YAML, ""), "map.yaml: expected lines such as"),
    ],
)
def test_a_wrong_map_file_is_named_with_its_line(tmp_path, change, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_map(write(tmp_path, YAML.replace(*change)))
    assert "\n" not in str(caught.value)


def test_a_wrong_image_or_no_file_is_named(tmp_path):
    path = write(tmp_path)
    with pytest.raises(ValueError, match="nowhere.yaml: no such file"):
        read_map(tmp_path / "nowhere.yaml")
    for content in (b"no picture", b"P5 300 300 255\n123"):
        (tmp_path / "map.pgm").write_bytes(content)
        with pytest.raises(ValueError, match="map.pgm: is no PGM, PNG or BMP image that can be read") as caught:
            read_map(path)
        assert "\n" not in str(caught.value)


def test_an_unknown_key_is_not_passed_over_in_silence(tmp_path):
    with pytest.warns(UserWarning, match="map.yaml, line 7: moed: is no key of a map"):
        read_map(write(tmp_path, YAML + "moed: scale\n"))


# Costs


def nav2_cost(distance: float, inflation: Inflation) -> int:
    """The rule of nav2_costmap_2d/inflation_layer.hpp, distance in m."""
    if distance == 0:
        return 254
    if distance <= inflation.robot_radius:
        return 253
    if distance > math.ceil(inflation.inflation_radius / 0.05 - 1e-9) * 0.05 + 1e-9:
        return 0
    return int(252 * math.exp(-inflation.cost_scaling_factor * (distance - inflation.robot_radius)))


@pytest.mark.parametrize("radius", [0.22, 0.55, 0.53])
def test_inflation_is_that_of_nav2(radius):
    inflation = Inflation(inflation_radius=radius, cost_scaling_factor=3.0)
    cost = np.zeros(GRID.shape, int)
    cost[[4, 20, 21], [40, 10, 11]] = 254
    layers = layers_of(GRID, static_layer(StaticMap(GRID, cost)), None, inflation)
    distance = distance_transform_edt(cost == 0) * 0.05
    expected = [[nav2_cost(d, inflation) for d in line] for line in distance]
    np.testing.assert_array_equal(layers.total(), expected)
    assert len(np.unique(expected)) > 5


def test_robots_are_discs_with_the_same_decay_around_them():
    inflation, radius = Inflation(cost_scaling_factor=3.0), 0.12
    static = static_layer(map_of_shapes(GRID))
    at = np.array([[0.31, -0.12], [0.8, 0.4], [-2.0, 0.0]])
    layers = layers_of(GRID, static, Obstacles(jnp.asarray(at[:, 0]), jnp.asarray(at[:, 1]), radius=radius), inflation)
    x, y = GRID.centres()
    distance = np.min([np.maximum(np.hypot(x - a, y - b) - radius, 0) for a, b in at], axis=0)
    expected = [[nav2_cost(d, inflation) for d in line] for line in distance]
    np.testing.assert_array_equal(layers.total(), expected)
    np.testing.assert_array_equal(layers.obstacles, np.where(distance == 0, 254, 0))


def test_age_times_speed_and_sigma_shift_the_zone_outwards():
    static, plain = static_layer(map_of_shapes(GRID, [Disc((-0.6, 0.6), 0.1)])), Inflation(cost_scaling_factor=3.0)
    here = Obstacles(jnp.array([0.5]), jnp.array([0.2]), jnp.array([0.4]), 0.25)
    moved = layers_of(GRID, static, here, plain)
    grown = layers_of(GRID, static, Obstacles(here.x, here.y, radius=0.205), plain)  # 0.105 + 0.4 · 0.25
    x, _ = (np.broadcast_to(each, GRID.shape) for each in GRID.centres())
    beyond = (np.asarray(grown.obstacles) == 0) & (x > 0)
    np.testing.assert_array_equal(np.asarray(moved.total())[beyond], np.asarray(grown.total())[beyond])
    assert (np.asarray(moved.obstacles) == 254).sum() < (np.asarray(grown.obstacles) == 254).sum()
    unsure = layers_of(
        GRID, static, here, Inflation(cost_scaling_factor=3.0, localisation_sigma=0.03, sigma_factor=2.0)
    )
    wider = layers_of(GRID, static, here, Inflation(0.165, 0.61, 3.0))
    near = np.asarray(unsure.total()) > 60  # at the rim the radius is rounded up to whole cells before it is widened
    np.testing.assert_array_equal(np.asarray(unsure.total())[near], np.asarray(wider.total())[near])
    assert (unsure.total() >= moved.total()).all() and (unsure.total() > moved.total()).any()


def test_an_older_position_never_costs_less():
    static = static_layer(map_of_shapes(GRID))
    age = jnp.array([0.0, 0.1, 0.5, 2.0, math.inf])
    totals = layers_of(
        GRID, static, Obstacles(jnp.full((5, 1), 0.3), jnp.zeros((5, 1)), age[:, None], 0.7), Inflation()
    )
    cost = np.asarray(totals.total())
    assert (np.diff(cost, axis=0) >= 0).all() and (cost[-1] >= 253).all() and not np.isnan(cost).any()
    still = layers_of(
        GRID, static, Obstacles(jnp.array([0.3]), jnp.array([0.0]), jnp.array([math.inf]), 0.0), Inflation()
    )
    np.testing.assert_array_equal(still.total(), cost[0])


def test_the_sum_of_layers_keeps_open_cells_open_and_closed_ones_closed():
    cost = np.zeros(GRID.shape, int)
    cost[10:20, 10:20], cost[15, 15], cost[0:6] = 200, 254, 255
    layers = layers_of(GRID, static_layer(StaticMap(GRID, cost), True), Obstacles(jnp.array([-0.7]), jnp.array([-0.3])),
                       Inflation(cost_scaling_factor=2.0))  # fmt: skip
    total, parts = np.asarray(layers.total()), [np.asarray(each) for each in layers]
    closed = np.max([np.where(parts[0] == 255, 0, parts[0]), *parts[1:]], axis=0) >= 253
    np.testing.assert_array_equal(total[~closed & (cost == 255)], 255)
    np.testing.assert_array_equal((total >= 253) & (total < 255), closed)
    open_ = ~closed & (cost != 255)
    np.testing.assert_array_equal(total[open_], np.minimum(sum(parts)[open_], 252))
    assert (total[open_] == 252).any()  # 200 and what is around the obstacle


def test_unknown_cells_are_free_unless_they_are_tracked():
    cost = np.zeros(GRID.shape, int)
    cost[3] = 255
    assert not np.asarray(static_layer(StaticMap(GRID, cost)).cost).any()
    assert (np.asarray(static_layer(StaticMap(GRID, cost), True).cost)[3] == 255).all()


def test_each_robot_of_each_simulation_has_a_map_without_itself():
    rng = np.random.default_rng(3)
    x, y = (jnp.asarray(rng.uniform(-0.4, 1.0, (3, 2))) for _ in range(2))  # [N, *B]
    age = jnp.asarray(rng.uniform(0, 0.5, (3, 2)))
    static = static_layer(map_of_shapes(GRID, [Rectangle((0.9, 0.9), (0.4, 0.3))]))
    many = layers_of(GRID, static, Obstacles(others(x), others(y), others(age), 0.7), Inflation())
    assert many.inflation.shape == (3, 2, *GRID.shape)
    for robot, rest in ((0, [1, 2]), (1, [0, 2]), (2, [0, 1])):
        for sim in range(2):
            seen = (v[jnp.array(rest), sim] for v in (x, y, age))
            alone = layers_of(GRID, static, Obstacles(*seen, 0.7), Inflation()).total()
            np.testing.assert_array_equal(alone, many.total()[robot, sim])


def test_one_inflation_per_map():
    static = static_layer(map_of_shapes(GRID, [Disc((0.0, 0.2), 0.2)]))
    seen = Obstacles(jnp.zeros((2, 1)), jnp.full((2, 1), 0.9))
    many = layers_of(GRID, static, seen, Inflation(cost_scaling_factor=jnp.array([2.0, 8.0]))).total()
    for k, rate in enumerate((2.0, 8.0)):
        alone = layers_of(GRID, static, Obstacles(seen.x[k], seen.y[k]), Inflation(cost_scaling_factor=rate)).total()
        np.testing.assert_array_equal(alone, many[k])


def test_a_start_or_goal_in_an_obstacle_is_named():
    cost = layers_of(GRID, static_layer(map_of_shapes(GRID, [Disc((0.0, 0.2), 0.2)])), None, Inflation()).total()
    check_free("goal", [[0.9, 0.2], [-0.9, -0.4]], GRID, cost)
    with pytest.raises(ValueError, match=r"goal: got \(0, 0.2\) for robot 1, which is in an obstacle \(cost 254\)"):
        check_free("goal", [[0.9, 0.2], [0.0, 0.2]], GRID, cost)
    with pytest.raises(ValueError, match="start: got .* nearer to an obstacle than the robot's radius"):
        check_free("start", [0.26, 0.2], GRID, cost)
    with pytest.raises(
        ValueError, match=r"start: got \(5, 0\) for robot 0, which is beside the map, expected x from -1"
    ):
        check_free("start", [5.0, 0.0], GRID, cost)


@pytest.mark.parametrize("seed", range(4))
def test_a_costmap_made_in_patches_is_the_whole_one(seed):
    rng = np.random.default_rng(seed)
    grid = Grid(0.05, (-1.3, 0.7), (90, 110))
    static = static_layer(StaticMap(grid, np.where(rng.random(grid.shape) < 0.003, 254, 0).astype(np.uint8)))
    inflation = Inflation(inflation_radius=(0.55, 0.3, 0.0, 0.4)[seed], localisation_sigma=0.02)
    count = 1 + seed
    x, y = rng.uniform(-1.6, 4.5, count), rng.uniform(0.4, 5.5, count)  # some beside the map
    discs = Obstacles(jnp.asarray(x), jnp.asarray(y), 1.0, jnp.asarray(rng.uniform(0, 0.4, count)), 0.105)
    whole = costmap_layers(grid, static, discs, inflation).total()
    alone = costmap_layers(grid, static, None, inflation).total()
    reach = influence(inflation, grid.resolution, 0.105, 0.4)
    assert not np.array_equal(whole, alone)
    np.testing.assert_array_equal(patched(alone, grid, static, discs, inflation, reach), whole)
