"""A study cut into chunks: pieces with stable names that can be computed anywhere, in any order, any number of times.

A chunk is a rectangle of designs x seeds. Where no group of one tau and deadline is too large for one, it holds whole
groups, and seeds in multiples of what one batch holds, so the batches that run, and with them the bits of the results,
are those of the study in one piece.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from qocjax._room import check_room
from qocjax.batch.evaluate import evaluate
from qocjax.batch.layout import LANES, WIDEST
from qocjax.scenario import Design, num_ticks
from qocjax.store.provenance import made_with
from qocjax.study.problem import Problem

__all__ = ["CHUNK_STEPS", "Chunk", "Engine", "Failure", "Part", "Result", "compute", "plan", "steps_of"]

# Robot-steps of a chunk: about half a second of one core.
CHUNK_STEPS = 1e8

_CHUNK_BYTES, _SEED_BYTES = 500, 50  # in memory, of a chunk and of a seed

# Of a controller that is costly a chunk has that many times fewer: a minute of one core with the navigation stack.
_COSTLY = 1000


@dataclass(frozen=True)
class Part:
    """One half of a study: `selection`, all designs on some seeds, or `evaluation`, the chosen ones on others."""

    name: str
    seeds: Sequence[int]  # [S], a range or a tuple
    designs: tuple[int, ...] | None = None  # places in the problem's designs; None for all

    def values(self, problem: Problem) -> Design:
        """The designs of this part, each value an array."""
        if self.designs is None:
            return problem.designs
        return problem.designs.at(list(self.designs))


@dataclass(frozen=True)
class Chunk:
    """A rectangle of a part; plain values, so that it can be sent anywhere."""

    name: str  # stable: the same configuration gives the same chunks with the same names
    part: Part
    designs: tuple[int, ...]  # places in the part's designs, ascending
    seeds: tuple[int, int]  # first and one past the last place in the part's seeds
    steps: int  # robot-steps, to weigh the work

    @property
    def runs(self) -> int:
        """Simulations."""
        return len(self.designs) * (self.seeds[1] - self.seeds[0])

    def describe(self) -> dict[str, Any]:
        """Itself as plain values, to be written with its results; the name stands for the designs and seeds."""
        return {"name": self.name, "part": self.part.name, "designs": len(self.designs), "seeds": list(self.seeds)}


@dataclass(frozen=True)
class Result:
    """Metrics of a chunk's runs."""

    values: dict[str, np.ndarray]  # [designs, seeds] or [designs, seeds, N]
    attributes: dict[str, str]  # which functions of angles ran, and the width of numbers
    made_with: dict[str, str]  # versions and device, in the process that computed it


@dataclass(frozen=True)
class Failure:
    """Why a chunk has no results, in one line."""

    cause: str


class Engine(Protocol):
    """What computes chunks. Results live in files that the study writes, never in the engine."""

    def run(self, problem: Problem, chunks: Sequence[Chunk]) -> Generator[tuple[Chunk, Result | Failure], None, None]:
        """Yields each chunk once, in any order, as it is finished; closing the generator stops what is under way.

        Raises:
            ValueError: The problem itself is wrong, so that no chunk could be computed.
        """
        ...


def compute(problem: Problem, chunk: Chunk, pool: Executor | None = None) -> Result:
    """Simulates a chunk: a pure function of its arguments, in float32.

    Args:
        problem: What is simulated.
        chunk: Which part of it, from `plan`.
        pool: Threads that run its batches; by default as many as there are cores.

    Raises:
        ValueError: What `evaluate` raises.
    """
    values = chunk.part.values(problem)
    members, setup = next(each for each in problem.groups(values) if chunk.designs[0] in each[0])
    runs = evaluate(
        setup.scenario, problem.numbers(values.at(members)), setup.network, chunk.part.seeds,
        rules=setup.rules, key=problem.key, controller=setup.controller,
        only=(np.searchsorted(members, chunk.designs).tolist(), range(*chunk.seeds)), pool=pool,
    )  # fmt: skip
    return Result({str(name): runs[name].values for name in runs.data_vars}, dict(runs.attrs), made_with())


def plan(problem: Problem, part: Part, chunk_steps: float = CHUNK_STEPS) -> list[Chunk]:
    """Cuts a part into chunks; depends on nothing but its arguments.

    Args:
        problem: What is simulated.
        part: All of it that is planned here.
        chunk_steps: Robot-steps that a chunk should have, about; a thousandth of them for a costly controller.
    """
    target = max(1.0, chunk_steps / (_COSTLY if problem.controller is not None and problem.controller.costly else 1))
    values = part.values(problem)
    steps = steps_of(problem, values)
    lanes = min(len(part.seeds), WIDEST if np.unique(values.tau).size == 1 else LANES)
    many = f"{len(part.seeds):.4g} seeds of {len(steps):.4g} designs"
    check_room("seeds, designs", many, _least(part, steps, target), "fewer, or larger chunks (chunk_steps)")
    blocks = _seed_blocks(len(part.seeds), lanes * max(1, int(target // (steps.sum() * lanes))))
    pieces: list[np.ndarray] = []
    for members, _ in problem.groups(values):  # a chunk is of one set-up
        tau, deadline = (np.broadcast_to(a, len(steps))[members] for a in (values.tau, values.deadline))
        atoms = [members[atom] for atom in _atoms(tau, deadline, steps[members] * lanes, target)]
        weights = np.array([int(steps[atom].sum()) for atom in atoms])
        pieces += [np.sort(np.concatenate([atoms[k] for k in piece])) for piece in _packed(weights * lanes, target)]
    designs = [(tuple(piece.tolist()), int(steps[piece].sum())) for piece in pieces]
    rectangles = [(seeds, piece, each) for seeds in blocks for piece, each in designs]
    return [
        _named(number, part, piece, seeds, each * (seeds[1] - seeds[0]))
        for number, (seeds, piece, each) in enumerate(rectangles)
    ]


def _least(part: Part, steps: np.ndarray, target: float) -> float:
    """Bytes that a part takes at least: its chunks' names, and the runs of one design while they are averaged."""
    chunks = float(steps.sum()) * len(part.seeds) / target
    return _CHUNK_BYTES * chunks + _SEED_BYTES * len(part.seeds)


def steps_of(problem: Problem, designs: Design) -> np.ndarray:
    """Robot-steps of each design with one seed, [G]."""
    tau = np.broadcast_to(designs.tau, np.size(designs.tau))
    steps = np.empty(tau.size, int)
    for members, setup in problem.groups(designs):
        periods, place = np.unique(tau[members], return_inverse=True)
        ticks = np.array([num_ticks(setup.scenario.horizon, period) for period in periods])[place]
        steps[members] = ticks * setup.scenario.num_robots
    return steps


def _atoms(tau: np.ndarray, deadline: np.ndarray, steps: np.ndarray, target: float) -> Iterator[np.ndarray]:
    """Groups of designs with one tau and deadline, in that order; large ones in equal parts."""
    order = np.lexsort((deadline, tau))
    new = (np.diff(tau[order]) != 0) | (np.diff(deadline[order]) != 0)
    for group in np.split(order, np.flatnonzero(new) + 1):
        yield from np.array_split(group, min(len(group), max(1, int(np.ceil(steps[group].sum() / target)))))


def _packed(weights: np.ndarray, target: float) -> list[np.ndarray]:
    """Cuts a row of weights into consecutive pieces of about equal weight, none far above the target."""
    total = weights.sum()
    count = int(np.ceil(total / target))
    middle = np.cumsum(weights) - weights / 2
    piece = np.minimum((middle / total * count).astype(int), count - 1)
    return np.split(np.arange(len(weights)), np.flatnonzero(np.diff(piece)) + 1)


def _seed_blocks(num_seeds: int, length: int) -> list[tuple[int, int]]:
    """Blocks of that length; the last takes what would be too little for a batch of its own."""
    starts = list(range(0, num_seeds, length))
    if len(starts) > 1 and num_seeds - starts[-1] < LANES:
        starts.pop()
    return list(zip(starts, [*starts[1:], num_seeds], strict=True))


def _named(number: int, part: Part, designs: tuple[int, ...], seeds: tuple[int, int], steps: int) -> Chunk:
    content = json.dumps([part.name, part.designs, [int(seed) for seed in part.seeds[slice(*seeds)]], designs])
    digest = hashlib.blake2b(content.encode(), digest_size=6).hexdigest()
    return Chunk(f"{part.name}-{number:05d}-{digest}", part, designs, seeds, steps)
