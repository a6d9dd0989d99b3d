"""The last net of the commands: what a check says passes as it is, memory is told of, all else with its place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from qocjax import QocScale, Scenario, _checks
from qocjax.commands.foreseen import is_foreseen, memory_text
from qocjax.scenario import num_ticks

CHECKED: list[Callable[[], Any]] = [
    lambda: Scenario(horizon="long"), lambda: QocScale(0.0, 1.0), lambda: _checks.count("n", 1.5),
    lambda: num_ticks(1e30, 1.0), lambda: open("/no/such/file"), lambda: OmegaConf.create({"a": "${b}"}).a,
]  # fmt: skip
UNFORESEEN: list[Callable[[], Any]] = [
    lambda: len(1.0), lambda: int("x"), lambda: [][0], lambda: np.zeros(2) + np.zeros(3), lambda: float("1_"),  # type: ignore[arg-type]
    lambda: np.array([1.0, None]) * 2, lambda: {}["a"], lambda: int(float("inf")), lambda: 1 / 0, lambda: range(1.5),  # type: ignore[call-overload]
    lambda: _checks.numbers(*[1]), lambda: Scenario(no=1),  # type: ignore[call-arg]
]  # fmt: skip


def raised(call: Callable[[], Any]) -> Exception:
    with pytest.raises(Exception) as caught:
        call()
    return caught.value


@pytest.mark.parametrize("call", CHECKED, ids=range(len(CHECKED)))
def test_what_a_check_says_is_foreseen(call: Callable[[], Any]) -> None:
    assert is_foreseen(raised(call))


@pytest.mark.parametrize("call", UNFORESEEN, ids=range(len(UNFORESEEN)))
def test_what_python_says_of_code_is_not(call: Callable[[], Any]) -> None:
    error = raised(call)
    assert not is_foreseen(error) and memory_text(error) is None


def test_memory_that_ran_out_is_one_line() -> None:
    for error in (
        MemoryError(), MemoryError("Unable to allocate 8.00 TiB for an array"),
        RuntimeError("INTERNAL: Error dispatching computation:\nOut of memory allocating 121036801360 bytes."),
        RuntimeError("RESOURCE_EXHAUSTED: 9 GB"),
    ):  # fmt: skip
        text = memory_text(error)
        assert text is not None and text.startswith("memory: got ") and "expected" in text and "\n" not in text
