"""Time per rollout-step of the MPPI controller, beside NumPy and C++ with the same critics, for one robot.

    python experiments/bench/mppi.py [--samples 2000] [--steps 56] [--repeats 60] [--out folder]

One rollout-step is one step of one rollout, with the noise that it draws and all critics. All entries do the same
cycle, on the same map and path, and take turns; before they are timed, qocjax, NumPy and C++ score the same samples,
and the last lines say how far costs and commands differ. The C++ loop is what grows with K, written by hand for
AVX-512: the yardstick; it needs g++ and a K that is a multiple of 16, and is left out else. Compile time is apart.
Writes mppi.csv; about half a minute.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from experiments.bench.baselines.mppi_cpp import CppMppi
from experiments.bench.baselines.mppi_numpy import NumpyMppi
from experiments.bench.baselines.work import Unavailable
from experiments.bench.timing import machine
from qocjax._xla import compiled, num_workers, request_whole_loop
from qocjax.navigation.local_path import MapCosts
from qocjax.navigation.mppi import initial_state, step, step_each
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.noise import normal_pairs, seed_of

RESULTS = Path(__file__).parent / "results"
ROBOTS = 8  # of the batch
CPP = "C++ loop, one robot"
ONE, MANY, NOISE = "qocjax, one robot", f"qocjax, {ROBOTS} robots", "qocjax, noise alone"

# Nav2 on a desktop CPU: 7.5 ms a cycle of 2000 x 50 (ms to ns per rollout-step).
NAV2_NS = 7.5e6 / (2000 * 50)


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A map of 10 m x 10 m in cells of 5 cm with 30 inflated posts, a pose, a path of 4 m between them, and its end."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(-5 + 0.05 * (np.arange(200) + 0.5), -5 + 0.05 * (np.arange(200) + 0.5))
    posts = rng.uniform(-5, 5, (60, 2))
    posts = posts[np.abs(posts[:, 1]) > 0.8][:30]
    distance = np.min(np.hypot(x[..., None] - posts[:, 0], y[..., None] - posts[:, 1]), axis=-1)
    cost = np.where(distance < 0.2, 253.0, np.where(distance < 0.75, 252 * np.exp(-3 * (distance - 0.2)), 0.0))
    path = np.stack([np.linspace(-2, 2, 100), 0.2 * np.sin(np.linspace(0, np.pi, 100))], axis=1)
    return np.floor(cost), np.array([-1.9, 0.05, 0.2]), path, np.array([2.0, 0.0, 0.0])


class Entries:
    """The calls that are timed, each one a cycle that starts from rest."""

    def __init__(self, config: MppiConfig) -> None:
        """Compiles them."""
        cells, pose, path, goal = scene()
        self.config, self.pose, self.path, self.goal = config, pose, path, goal
        self.costs = MapCosts(jnp.asarray(cells, jnp.float32), 0.05, (-5.0, -5.0))
        self.numpy = NumpyMppi(config, cells, 0.05, (-5.0, -5.0))
        self.cpp = _cpp(config, cells)
        self.rng = np.random.default_rng(0)
        self.compile_s: dict[str, float] = {}
        arrays = [jnp.asarray(each, jnp.float32) for each in (pose, path, goal)]
        one = (initial_state(config, jnp.float32), arrays[0], self.costs, *arrays[1:], jax.random.key(0))
        many = jax.tree.map(lambda a: jnp.stack([a] * (ROBOTS // num_workers())), one)
        self.args = {"one": one, "many": many}
        self.calls = {
            "qocjax, one robot": self._compile("qocjax, one robot", lambda *a: step(config, *a), "one"),
            f"qocjax, {ROBOTS} robots": self._compile(
                f"qocjax, {ROBOTS} robots", lambda *a: step_each(config, *a), "many"
            ),
            "qocjax, noise alone": self._compile("qocjax, noise alone", self._noise, "one"),
        }

    def _noise(self, *args: object) -> tuple[jax.Array, jax.Array]:
        return normal_pairs(args[-1], self.config.time_steps, self.config.batch_size, jnp.float32)

    def _compile(self, name: str, function: Callable, arguments: str) -> Callable[[], object]:
        begin = time.perf_counter()
        program = compiled(jax.jit(function).lower(*self.args[arguments]))
        self.compile_s[name] = time.perf_counter() - begin
        return lambda: jax.block_until_ready(program(*self.args[arguments]))

    def numpy_cycle(self, noise: np.ndarray | None = None) -> np.ndarray:
        """One cycle in NumPy, from rest; returns the costs."""
        c = self.config
        self.numpy.sequence[:], self.numpy.past[:] = 0.0, 0.0
        if noise is None:
            noise = self.rng.standard_normal((2, c.time_steps, c.batch_size), np.float32)
        self.numpy.step(self.pose.astype(np.float32), self.path, self.goal.astype(np.float32), noise)
        return self.numpy.cost

    def cpp_cycle(self) -> tuple[np.ndarray, np.ndarray]:
        """One cycle in C++, from rest, with the noise of qocjax's; costs and command."""
        assert self.cpp is not None
        self.cpp.sequence[:], self.cpp.past[:] = 0.0, 0.0
        words = np.asarray(seed_of(jax.random.fold_in(jax.random.key(0), 0)))
        command = self.cpp.step(self.pose.astype(np.float32), self.path, self.goal.astype(np.float32), words)
        return self.cpp.cost, command

    def difference_from_cpp(self) -> tuple[float, float]:
        """Of the costs in qocjax and in C++, as for NumPy, and of the commands (m/s, rad/s)."""
        command, _, rollouts = self.calls[ONE]()
        cost, theirs = self.cpp_cycle()
        costs = np.quantile(np.abs(np.asarray(rollouts.cost) - cost), 0.99) / np.median(cost)
        return float(costs), float(np.max(np.abs(np.array([command.nu, command.omega]) - theirs)))

    def largest_difference(self) -> float:
        """Of the costs in qocjax and in NumPy for the same samples, relative to the median cost."""
        ours = np.asarray(self.calls["qocjax, one robot"]()[2].cost)
        key = jax.random.fold_in(jax.random.key(0), 0)
        theirs = self.numpy_cycle(
            np.stack(normal_pairs(key, self.config.time_steps, self.config.batch_size, np.float32))
        )
        return float(np.quantile(np.abs(ours - theirs), 0.99) / np.median(theirs))


def _cpp(config: MppiConfig, cells: np.ndarray) -> CppMppi | None:
    try:
        return CppMppi(config, cells, 0.05, (-5.0, -5.0))
    except (Unavailable, ValueError) as reason:
        print(f"without the C++ loop: {reason}")
        return None


def timed(entries: Entries, repeats: int) -> pd.DataFrame:
    """The best and the median of several calls, which take turns."""
    per = entries.config.batch_size * entries.config.time_steps
    workers = num_workers()
    seconds: dict[str, list[float]] = {}
    with ThreadPoolExecutor(workers) as pool:
        calls = {name: (call, per) for name, call in entries.calls.items()}
        batch = entries.calls[MANY]
        calls[MANY] = (lambda: list(pool.map(lambda _: batch(), range(workers))), per * (ROBOTS // workers) * workers)
        calls["NumPy, one robot"] = (entries.numpy_cycle, per)
        if entries.cpp is not None:
            entries.cpp_cycle()
            calls[CPP] = (entries.cpp.loop, per)
        for _ in range(repeats):
            for name, (call, _) in calls.items():
                begin = time.perf_counter()
                call()
                seconds.setdefault(name, []).append(time.perf_counter() - begin)
    rows = [
        {
            "entry": name,
            "ms_per_call": 1e3 * min(times),
            "median_ms": 1e3 * float(np.median(times)),
            "ns_per_rollout_step": 1e9 * min(times) / calls[name][1],
            "compile_s": entries.compile_s.get(name, 0.0),
        }
        for name, times in seconds.items()
    ]
    return pd.DataFrame(rows)


def main() -> None:
    """Measures, prints and writes the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=2000, help="K, rollouts")
    parser.add_argument("--steps", type=int, default=56, help="H, steps of a rollout")
    parser.add_argument("--repeats", type=int, default=60)
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    if options.repeats < 1:
        parser.error(f"repeats: got {options.repeats}, expected 1 or more")
    request_whole_loop()
    try:
        config = MppiConfig(batch_size=options.samples, time_steps=options.steps)
    except ValueError as error:
        parser.error(str(error))
    entries = Entries(config)
    difference = entries.largest_difference()
    from_cpp = entries.difference_from_cpp() if entries.cpp is not None else None
    table = timed(entries, options.repeats)
    here = machine()
    table["samples"], table["steps"], table["robots_at_once"] = options.samples, options.steps, 1
    table.loc[table.entry == MANY, "robots_at_once"] = ROBOTS
    for key in ("cpu", "vector", "cores", "jax", "numpy", "python"):
        table[key] = here[key]
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out / "mppi.csv", index=False, float_format="%.5g")
    print(table.iloc[:, :5].to_string(index=False, float_format="%.3g"))
    print(f"costs of the same samples: 99 % agree to {difference:.1e} of the median cost")
    if from_cpp is not None:
        print(f"in C++: costs to {from_cpp[0]:.1e} of it, the command to {from_cpp[1]:.1e} m/s and rad/s")
    print(f"Nav2's own figure on a desktop CPU (2000 x 50, 7.5 ms): {NAV2_NS:.0f} ns per rollout-step")


if __name__ == "__main__":
    main()
