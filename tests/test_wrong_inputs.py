"""Wrong inputs for every command end in one line, in seconds: a handful here, hundreds in the slow one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="children are made by fork, and watched by pidfd")


def tried(count: int, seed: int, *more: str) -> dict[str, int]:
    """What came of random inputs; prints those with a fault."""
    command = [
        sys.executable,
        "-W",
        "ignore",
        ROOT / "tests" / "wrong_inputs.py",
        str(count),
        "--seed",
        str(seed),
        *more,
    ]
    environment = os.environ | {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr
    last: dict[str, int] = json.loads(done.stdout.splitlines()[-1])
    return last


def test_a_handful_of_wrong_inputs_is_refused_in_one_line() -> None:
    found = tried(10, 0, "--no-studies")  # one for each command
    assert found["tried"] == 10 and found["faults"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_hundreds_of_wrong_inputs_are_refused_in_one_line(seed: int) -> None:
    found = tried(200, seed)
    assert found["tried"] == 200 and found["faults"] == 0
