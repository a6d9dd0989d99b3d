"""Reading speed of recorded runs: a bag of 320 MB, two robots whose odometry comes at 200 Hz, as SQLite3 and as MCAP.

    python experiments/bench/bag.py                        # this checkout
    python experiments/bench/bag.py ../other-checkout      # and another one, in turns with it

Prints seconds and peak memory of `python -m qocjax.ingest` for each, the best of three. The two bags are written to a
temporary folder, or to BAGS if that is set, where they stay.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rosbags.rosbag2 import StoragePlugin, Writer

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from bags import EPOCH, ODOM, STORE, pose  # noqa: E402

MESSAGES, PERIOD = 209_000, 5_000_000  # of each robot; ns
REPEATS = 3


def write(path: Path, plugin: StoragePlugin) -> None:
    """Robots that drive along x at 0.2 m/s; only stamp and position differ from message to message."""
    data = bytearray(STORE.serialize_cdr(pose(ODOM, 0.0, 1.25, 0.0, 0.0, "odom"), ODOM))
    place = data.find(struct.pack("<d", 1.25))
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics = [writer.add_connection(f"/robot{k}/odom", ODOM, typestore=STORE) for k in range(2)]
        for k in range(MESSAGES):
            stamp = EPOCH + k * PERIOD
            struct.pack_into("<II", data, 4, *divmod(stamp, 10**9))
            struct.pack_into("<d", data, place, 1e-3 * k)
            for topic in topics:
                writer.write(topic, stamp + 2_000_000, bytes(data))


def read(checkout: Path, bag: Path, scratch: Path) -> tuple[float, float]:
    """Seconds and peak memory (MB) of one run."""
    command = [sys.executable, "-m", "qocjax.ingest", f"path={bag}", "figures=false", f"hydra.run.dir={scratch}"]
    environment = os.environ | {"PYTHONPATH": str(checkout), "JAX_PLATFORMS": "cpu"}
    begin = time.perf_counter()
    process = subprocess.Popen(command, cwd=checkout, env=environment, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{checkout}: ended with {status}")
    return time.perf_counter() - begin, usage.ru_maxrss / 1e3


def main() -> None:
    """Writes what is not there yet, and reads it with each checkout in turn."""
    checkouts = [ROOT, *(Path(name).resolve() for name in sys.argv[1:])]
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(os.environ.get("BAGS", scratch))
        for name, plugin in (("sqlite3", StoragePlugin.SQLITE3), ("mcap", StoragePlugin.MCAP)):
            bag = place / f"bench_{name}"
            if not bag.exists():
                write(bag, plugin)
            size = sum(file.stat().st_size for file in bag.iterdir()) / 1e6
            found: dict[Path, list[tuple[float, float]]] = {each: [] for each in checkouts}
            for _ in range(REPEATS):
                for checkout in checkouts:
                    found[checkout].append(read(checkout, bag, Path(scratch) / "out"))
            for checkout, runs in found.items():
                seconds, memory = min(runs)
                print(f"{name}, {size:.0f} MB, {2 * MESSAGES} messages, {checkout}: {seconds:.1f} s, {memory:.0f} MB")


if __name__ == "__main__":
    main()
