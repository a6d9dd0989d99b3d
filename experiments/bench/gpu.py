"""Robot-steps per second against the batch size on an accelerator, and what its memory allows.

    python experiments/bench/gpu.py [--size smallest|paper] [--out folder]

Each tick reads and writes what the scan carries. If nothing but that moved, the memory bandwidth, which is measured by
copying an array, would bound the speed. The table gives the share of the bound that is reached; it can exceed 1 while
the batch fits into a cache. Compilation is apart. A minute or two; on a machine without an accelerator it measures the
CPU and says so.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import jax
import jax.numpy as jnp
import pandas as pd

from experiments.bench.entries import ROOT
from experiments.bench.one_batch import OneBatch, Program
from experiments.bench.report import draw_rates, markdown, write
from experiments.bench.timing import machine, measure
from qocjax._xla import request_whole_loop

__all__ = ["bytes_per_robot_step", "copy_bandwidth", "main", "measure_batch"]

SEEDS = 32
# Designs of a batch, ticks, repeats, and bytes of the array that is copied.
SIZES: dict[str, tuple[tuple[int, ...], int, int, int]] = {
    "smallest": ((1,), 20, 1, 1 << 20),
    "paper": (tuple(4**k for k in range(9)), 3000, 3, 1 << 30),
}


def copy_bandwidth(size: int, repeats: int) -> float:
    """Bytes per second, read and written, of adding a number to an array of `size` bytes; the best of `repeats`."""
    array = jnp.zeros(size // 4, jnp.float32)
    add = jax.jit(lambda a: a + 1.0)
    timing = measure(lambda: jax.block_until_ready(add(array)), repeats)
    return 2 * array.nbytes / timing.best_s


def bytes_per_robot_step(program: Program, batch: OneBatch) -> float:
    """Bytes that a tick has to read and write of what the scan carries, for each robot of each run.

    Of the buffer of commands under way, one row is read and one written; all else is read and written. (The heading is
    counted though XLA leaves it out, as no metric reads it: 8 bytes.)
    """
    total = 0
    for value in program.carried():
        is_buffer = value.ndim == 4  # [slots, N, designs, seeds]
        total += 2 * value.dtype.itemsize * value.size // (value.shape[0] if is_buffer else 1)
    return total * batch.ticks / batch.robot_steps


def measure_batch(batch: OneBatch, repeats: int, bandwidth: float) -> dict[str, Any]:
    """Compiles and times one batch."""
    program = Program(batch)
    timing = measure(program.call, repeats)
    moved = bytes_per_robot_step(program, batch)
    rate, bound = batch.robot_steps / timing.best_s, bandwidth / moved
    return {
        "runs": batch.runs,
        "compile_s": program.compile_s,
        "best_s": timing.best_s,
        "us_per_tick": timing.best_s / batch.ticks * 1e6,
        "robot_steps_per_s": rate,
        "bytes_per_robot_step": moved,
        "bound_robot_steps_per_s": bound,
        "share_of_bound": rate / bound,
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=SIZES, default="paper")
    parser.add_argument("--out", type=Path, default=ROOT / "experiments" / "bench" / "results", metavar="folder")
    parser.add_argument("--seconds", type=float, default=300.0, help="start no further batch after so many")
    options = parser.parse_args()
    request_whole_loop()
    designs, ticks, repeats, copied = SIZES[options.size]
    device = {"backend": jax.default_backend(), "device": jax.devices()[0].device_kind}
    print(", ".join(f"{name}={value}" for name, value in device.items()))
    bandwidth = copy_bandwidth(copied, 10)
    print(f"copy bandwidth: {bandwidth / 1e9:.0f} GB/s, read and written", flush=True)
    rows: list[dict[str, Any]] = []
    begin = time.perf_counter()
    for count in designs:
        if rows and time.perf_counter() - begin > options.seconds:
            print(f"stopped before {count * SEEDS} runs: {options.seconds:g} s are over")
            break
        rows.append(measure_batch(OneBatch(count, SEEDS, ticks), repeats, bandwidth))
    table = pd.DataFrame(rows)
    print(markdown(table.map("{:.4g}".format)))
    record = {"machine": machine() | device, "size": options.size, "copy_bytes_per_s": bandwidth, "ticks": ticks}
    stem = f"batch_size_{device['backend']}"
    write(options.out, stem, table, record)
    draw_rates(table, f"{device['backend'].upper()}: {device['device']}", options.out / stem)


if __name__ == "__main__":
    main()
