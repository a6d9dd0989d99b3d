"""Pairs of commands and poses, against a controller whose choice is known; nodes without ROS; no ROS needed."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from qocjax.ros import Pairing

MS = 1_000_000


def test_the_true_pose_is_always_among_those_that_it_can_be() -> None:
    """Poses with jitter, a controller that takes 5 to 35 ms: spread and share say how far off the pair can be."""
    rng = np.random.default_rng(1)
    sent = np.cumsum(rng.uniform(15, 45, 2000))
    came = sent + rng.uniform(5, 60, 2000)
    begun = np.arange(100.0, came.max() - 100, 50.0)
    takes = rng.uniform(5, 35, begun.size)
    pairing = Pairing(fastest=0.005, slowest=0.035)
    events = [(round(time * MS), 0, k) for k, time in enumerate(came)]
    events += [(round((b + t) * MS), 1, k) for k, (b, t) in enumerate(zip(begun, takes, strict=True))]
    exact = 0
    for now, kind, k in sorted(events):
        if kind == 0:
            pairing.pose(round(sent[k] * MS), now)
            continue
        pair = pairing.command(now)
        assert pair is not None and not pair.proven
        true = round(sent[came <= begun[k]].max() * MS)
        assert pair.stamp - pair.spread <= true <= pair.stamp and pair.received <= now - 5 * MS
        assert (pair.poses == 1) == (pair.spread == 0)
        exact += pair.stamp == true
    counts = pairing.counts
    assert counts.pairs == begun.size and counts.unpaired == counts.proven == 0
    assert 0.2 < counts.ambiguous_share < 0.9 and 1 - counts.ambiguous_share <= exact / begun.size < 1
    assert 0 < counts.spread_mean < 1e-9 * counts.spread_max < 0.2


def test_a_command_that_bears_a_pose_s_stamp_is_proven() -> None:
    pairing = Pairing(0.0, 0.05)
    assert pairing.command(0, 5) is None and pairing.counts.unpaired == 1
    for k in range(3):
        pairing.pose(k * 20 * MS, (k * 20 + 5) * MS)
    assert pairing.command(46 * MS, 20 * MS) == (20 * MS, 25 * MS, 0, 1, True)
    assert pairing.command(46 * MS, 21 * MS) == (40 * MS, 45 * MS, 40 * MS, 3, False)
    assert pairing.counts.ambiguous_share == 0.5
    pairing.pose(10 * MS, 60 * MS)  # an old pose that came late is no newer one
    assert pairing.command(130 * MS) == (40 * MS, 45 * MS, 0, 1, False)


@pytest.mark.parametrize(
    ("times", "message"), [((0.1, 0.05), "fastest: got 0.1, expected at most"), ((-1.0, 1.0), "fastest: got -1")]
)
def test_bad_times_are_named(times: tuple[float, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Pairing(*times)


def test_every_module_imports_without_ros_and_a_node_says_what_is_missing() -> None:
    """In a Python that finds no rclpy, whether it is installed here or not."""
    folder = Path(importlib.import_module("qocjax.ros").__path__[0])
    modules = [f"qocjax.ros.{each.stem}" for each in folder.glob("*.py")]
    assert len(modules) > 8
    code = (
        "import sys; sys.modules['rclpy'] = None\nimport importlib\n"
        f"for name in {[each for each in modules if not each.endswith('__init__')]}: importlib.import_module(name)\n"
        "from qocjax.ros import deadline, stamps\nsys.argv = ['node']\nprint(deadline.main(), stamps.main())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == ["2", "2"], done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 2 and all("pip install 'qocjax[ros2]'" in line for line in lines)
