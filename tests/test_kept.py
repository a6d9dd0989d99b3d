"""Programs that are kept between runs: found again, told from others, and the same to the bit."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qocjax
import qocjax._kept as kept
import qocjax.batch.runner as runner
from qocjax import Design, QocScale, Rules, Scenario, paper_network
from qocjax._math import EXACT, POLYNOMIALS
from qocjax._once import Once
from qocjax._told import UntoldError, told
from qocjax.controllers import Apf
from qocjax.network import Constant
from qocjax.pairs import closest_squared
from qocjax.quality import initial_norm

pytest.importorskip("flatbuffers")


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    with kept.kept_in(tmp_path / "traced"):
        yield tmp_path / "traced"


@pytest.fixture
def traces(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the programs that are traced to be kept."""
    seen: list[str] = []
    traced = kept._exported

    def counting(jitted: Any, args: tuple, static: tuple) -> Any:
        seen.append(jitted.__name__)
        return traced(jitted, args, static)

    monkeypatch.setattr(kept, "_exported", counting)
    return seen


def a_study(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What a new process would evaluate."""
    monkeypatch.setattr(runner, "_programs", Once())
    monkeypatch.setattr(runner, "_kept", Once())
    scenario, designs = Scenario(horizon=2.0), Design(kappa=[1.0, 2.0], deadline=0.15)
    return qocjax.evaluate(scenario, designs, paper_network(), range(3), dtype=jnp.float32)


def test_what_one_process_traced_another_runs_to_the_same_bits(
    tmp_path: Path, traces: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = a_study(monkeypatch)
    assert traces == []
    with kept.kept_in(tmp_path):
        first, names = a_study(monkeypatch), list(traces)
        again = a_study(monkeypatch)
    assert sorted(names) == ["drawn", "metrics"] and traces == names
    assert first.identical(alone) and again.identical(alone)


def test_a_damaged_file_is_traced_again(folder: Path, traces: list[str]) -> None:
    args = (np.arange(4.0), np.arange(4.0) ** 2)
    right = kept.program(closest_squared, args, (), jax.stages.Lowered.compile)(*args)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    for number, damaged in enumerate((b"", whole[: len(whole) // 2], b"something else"), start=2):
        file.write_bytes(damaged)
        for _ in range(2):
            assert kept.program(closest_squared, args, (), jax.stages.Lowered.compile)(*args) == right
            assert len(traces) == number


def norm_of(scenario: Scenario) -> float:
    start, goal = jnp.asarray(scenario.start), jnp.broadcast_to(jnp.asarray(scenario.goal), (scenario.num_robots, 2))
    origin = (jnp.zeros(1), jnp.zeros(1))
    return float(jnp.sum(kept.called(initial_norm, (scenario, start, goal, origin), ())))


def test_a_change_of_what_is_static_or_of_the_source_is_another_program(
    folder: Path, traces: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = jax.tree.map(np.asarray, Scenario())
    found = [norm_of(each) for each in (scenario, replace(scenario, normaliser="goal_distance"))]
    assert found[0] != found[1] and len(list(folder.iterdir())) == 2
    monkeypatch.setattr(kept, "_programs", Once())
    assert norm_of(scenario) == found[0] and len(traces) == 2
    monkeypatch.setattr(kept, "_programs", Once())
    monkeypatch.setattr(kept, "_made_with", lambda: b"another version")
    assert norm_of(scenario) == found[0] and len(traces) == 3


def test_a_run_with_its_trajectory_is_kept_too(
    folder: Path, traces: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its scenario holds Python's numbers, beside arrays."""

    def run() -> Any:
        monkeypatch.setattr(kept, "_programs", Once())
        return qocjax.simulate(Scenario(horizon=1.0), Design(tau=0.05), np.full((20, 2), 0.05))

    first, again = run(), run()
    assert traces == ["_simulate"]
    assert np.array_equal(first.pose, again.pose) and np.array_equal(first.auc, again.auc)


def test_under_a_transformation_nothing_is_kept(folder: Path) -> None:
    scenario, times = Scenario(horizon=1.0), np.full((20, 2), 0.05)
    slope = jax.grad(lambda kappa: qocjax.simulate(scenario, Design(kappa=kappa, tau=0.05), times).auc.sum())(1.0)
    assert np.isfinite(slope) and not folder.exists()


@dataclass(frozen=True)
class Outside:
    """A value whose methods are not of the package."""

    value: float = 1.0


def test_content_tells_values_apart() -> None:
    values = [
        1, 1.0, True, None, "1", b"1", (1,), [1], {"a": 1}, {"a": 2}, np.float32(1), np.arange(3), np.arange(3.0),
        np.arange(4.0).reshape(2, 2), Rules(), Rules("arrival"), Apf(), Constant(0.1), Constant(0.2), EXACT,
        *(math for _, math in POLYNOMIALS), closest_squared, initial_norm, QocScale, Design,
        functools.partial(closest_squared, 1),
        *map(jax.tree.structure, [(1, 2), [1, 2], Scenario(), Scenario(horizon=3.0)]),
    ]  # fmt: skip
    contents = [b"".join(told(value)) for value in values]
    assert len(set(contents)) == len(values)
    assert [b"".join(told(value)) for value in values] == contents


@pytest.mark.parametrize(
    "value",
    [Outside(), lambda: 0, np.sort, object(), (1, Outside()), test_content_tells_values_apart, jax.random.key(0)],
)
def test_what_no_content_tells_is_not_kept(value: Any, folder: Path) -> None:
    with pytest.raises(UntoldError):
        list(told(value))
    args = (np.arange(3.0),)
    assert kept.program(lambda x, _: 2 * x, args, (1,), jax.stages.Lowered.compile)(*args).tolist() == [0.0, 2.0, 4.0]
    assert not folder.exists()
