"""QoS profiles x loss x burstiness x deadline: where does RELIABLE win over BEST_EFFORT, and by how much?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax.batch.evaluate import evaluate
from qocjax.network import Edge
from qocjax.network.dds import DdsNetwork
from qocjax.network.demand import Carrier
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario, num_ticks
from qocjax.statistics.estimates import relative
from qocjax.statistics.recorded import RecordedLoops, network_keys
from qocjax.statistics.scales import scale_of_runs
from qocjax.statistics.scores import Scores
from qocjax.statistics.together import told_apart
from qocjax.study.edges import at_bounds
from qocjax.transport.transport import bursty_loss, run_transport, traffic_row, transport_row

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Cell", "QosStudy", "qos_study"]

_METRICS = ("auc", "age_mean", "age_peak", "completed_share", "min_distance")


@dataclass(frozen=True)
class Cell:
    """One profile on one channel: what was simulated."""

    profile: str
    loss: float
    burst: float
    loop_times: np.ndarray  # [S, P, N] s
    runs: xr.Dataset  # metrics over (design, seed, robot), a design for each deadline


@dataclass(frozen=True)
class QosStudy:
    """What the study found."""

    # `difference_told` of a table: the sign of each difference that is told from 0, all of them together at 95 %.
    results: pd.DataFrame  # one row per profile, loss, burst and deadline
    transport: pd.DataFrame  # one row per profile, loss and burst
    best: pd.DataFrame  # one row per profile, loss and burst, each at its own best deadline
    most: pd.DataFrame  # one row per profile, loss and burst, at the one deadline at which it gains most
    scale: QocScale
    cells: list[Cell]


def qos_study(
    scenario: Scenario,
    design: Design,
    network: DdsNetwork,
    profiles: Mapping[str, Mapping[str, Any]],
    losses: Sequence[float],
    bursts: Sequence[float],
    deadlines: Sequence[float],
    seeds: Sequence[int],
    *,
    rules: Rules | None = None,
    key: int = 0,
    scale: QocScale | None = None,
    carrier: Carrier | None = None,
    edge: Edge | None = None,
    progress: Callable[[str], None] | None = None,
) -> QosStudy:
    """Simulates every profile on every channel with every deadline, all on the same seeds.

    Args:
        scenario: Robots and yardstick.
        design: Gains and sampling period; its deadline is not read.
        network: Delays, compute and topics; its losses are not read.
        profiles: Changes to the QoS of both topics by name; the first is the one that the others are compared with.
        losses: Shares of messages lost in each direction.
        bursts: Mean lengths of bursts of losses in sampling periods; 1 for independent losses.
        deadlines: Deadlines of the loop (s).
        seeds: Monte Carlo seeds.
        rules: Actuation and hold.
        key: Root of all random numbers.
        scale: J_med and J_max; by default of all runs of the study.
        carrier: 5G carrier, for resource blocks.
        edge: The workers, by default one for each sample; it may not give up what is late.
        progress: Called with a word on each cell before it is simulated.

    Raises:
        ValueError: An axis is empty, or a value out of range.
    """
    if edge is not None and edge.abort:
        raise ValueError("edge.abort: got True, expected False: a comparison at many deadlines has one set of loops")
    _check(network, profiles, {"loss": losses, "burst": bursts, "deadline": deadlines}, seeds)
    tau, ticks = float(np.asarray(design.tau)), num_ticks(scenario.horizon, float(np.asarray(design.tau)))
    keys, designs = network_keys(seeds, key), replace(design, deadline=np.asarray(deadlines, float))
    variants = {name: network.with_qos(**changes) for name, changes in profiles.items()}
    channels = [(burst, loss, bursty_loss(loss, burst)) for burst in bursts for loss in losses]
    cells, rows = [], []
    for burst, loss, process in channels:
        for name, variant in variants.items():
            if progress is not None:
                progress(f"{name}, {loss:.0%} lost")
            sent = run_transport(variant, process, keys, ticks, scenario.num_robots, tau, edge)
            recorded = RecordedLoops(keys, sent.loop_times, name)
            runs = evaluate(scenario, designs, recorded, seeds, rules=rules, key=key)
            cells.append(Cell(name, loss, burst, sent.loop_times, runs))
            place = {"profile": name, "loss": loss, "burst": burst}
            rows.append(place | transport_row(sent, tau) | traffic_row(sent, carrier or Carrier()))
    if scale is None:
        every = np.concatenate([cell.runs["auc"].values for cell in cells])
        scale = scale_of_runs(every, scenario, units=np.asarray(seeds))
    first = next(iter(profiles))
    results = _told(_results(cells, np.asarray(deadlines, float), scale, first), first, len(seeds))
    best, most = (_told(make(cells, scale, first), first, len(seeds) // 2) for make in (_best_deadlines, _most_gain))
    return QosStudy(results, pd.DataFrame(rows), best, most, scale, cells)


def _told(table: pd.DataFrame, baseline: str, seeds: int) -> pd.DataFrame:
    """Adds the sign of each difference that is told from 0, all of the table together."""
    rows = table["profile"] != baseline
    signs = pd.Series(0, table.index)
    signs[rows] = told_apart(table.loc[rows, "difference"], table.loc[rows, "difference_se"], seeds)
    return table.assign(difference_told=signs)


def _results(cells: list[Cell], deadlines: np.ndarray, scale: QocScale, baseline: str) -> pd.DataFrame:
    own = {(cell.loss, cell.burst): _scores(cell, scale) for cell in cells if cell.profile == baseline}
    rows = []
    for cell in cells:
        scores, others = _scores(cell, scale), own[cell.loss, cell.burst]
        for k, deadline in enumerate(deadlines):
            missed = 1.0 - float(cell.runs["completed_share"].values[k].mean())
            row = {"profile": cell.profile, "loss": cell.loss, "burst": cell.burst, "deadline": deadline,
                   "miss_share": missed, **_compared(scores[k], others[k])}  # fmt: skip
            for name in _METRICS:
                values = cell.runs[name].values[k].astype(float)
                row[name] = float(values.mean())
            row["collision_share"] = float(cell.runs["collided"].values[k].mean())
            rows.append(row | {"seeds": scores.values.shape[1]})
    return pd.DataFrame(rows)


def _scores(cell: Cell, scale: QocScale) -> Scores:
    """Scores [D, S]; the scale may be that of the same runs."""
    return Scores.of(cell.runs["auc"].values, scale, cell.runs["seed"].values)


def _compared(scores: Scores, others: Scores) -> dict[str, float]:
    """QoC, and its difference to another one in itself and in percent, each with its 95 % intervals."""
    gain = relative(scores.values - others.values, others.values, scores.units)
    percent = {"gain_percent": gain.mean, "gain_percent_low": gain.low, "gain_percent_high": gain.high}
    return (
        scores.mean().columns("qoc")
        | (scores - others).mean().columns("difference")
        | {name: 100.0 * value for name, value in percent.items()}
    )


def _best_deadlines(cells: list[Cell], scale: QocScale, baseline: str) -> pd.DataFrame:
    """Each profile at the deadline of its best QoC, compared with the baseline at its own.

    Deadlines are chosen on every other seed and judged on those between: a maximum of noisy scores flatters itself.

    Args:
        cells: As of `QosStudy`.
        scale: J_med and J_max.
        baseline: Profile to compare with.
    """
    found: dict[tuple[float, float], Scores] = {}
    rows = []
    for cell in sorted(cells, key=lambda c: c.profile != baseline):
        scores = _scores(cell, scale)
        k = int(scores.values[:, ::2].mean(axis=1).argmax())
        judged = scores.on(slice(1, None, 2))[k]
        at = (cell.loss, cell.burst)
        found.setdefault(at, judged)
        deadlines = cell.runs["deadline"].values
        place = {"profile": cell.profile, "loss": cell.loss, "burst": cell.burst, "deadline": float(deadlines[k])}
        ends = at_bounds(place, {}, {"deadline": deadlines.tolist()})
        rows.append(place | _compared(judged, found[at]) | {"at_edge": ends})
    return _in_order(rows, cells)


def _most_gain(cells: list[Cell], scale: QocScale, baseline: str) -> pd.DataFrame:
    """Each profile and the baseline at one deadline, that at which it gains most; chosen and judged as above."""
    own = {(cell.loss, cell.burst): _scores(cell, scale) for cell in cells if cell.profile == baseline}
    rows = []
    for cell in cells:
        scores, others = _scores(cell, scale), own[cell.loss, cell.burst]
        k = int((scores.values - others.values)[:, ::2].mean(axis=1).argmax())
        judged, base = (each.on(slice(1, None, 2))[k] for each in (scores, others))
        deadline = float(cell.runs["deadline"].values[k])
        place = {"profile": cell.profile, "loss": cell.loss, "burst": cell.burst, "deadline": deadline}
        rows.append(place | _compared(judged, base))
    return _in_order(rows, cells)


def _in_order(rows: list[dict[str, Any]], cells: list[Cell]) -> pd.DataFrame:
    """A table by channel, the profiles as they were given."""
    order = list(dict.fromkeys(cell.profile for cell in cells))
    return pd.DataFrame(rows).sort_values(
        ["burst", "loss", "profile"], key=lambda c: c.map(order.index) if c.name == "profile" else c
    )


def _check(network: object, profiles: Mapping, axes: dict[str, Sequence[float]], seeds: Sequence[int]) -> None:
    if not isinstance(network, DdsNetwork):
        raise ValueError(f"network: got {getattr(network, 'name', network)!r}, expected a DDS network (network=dds)")
    if len(profiles) < 2:
        raise ValueError(f"profiles: got {list(profiles)}, expected at least two, the first to compare with")
    for name, values in axes.items():
        array = np.atleast_1d(np.asarray(_checks.bounded(name, values, least=0.0), float))
        if array.size == 0 or np.unique(array).size != array.size or np.any(np.diff(array) < 0):
            raise ValueError(f"{name}: got {array.tolist()}, expected at least one value, ascending, each once")
    _checks.counts("seeds", seeds)
    if len(seeds) < 4:
        raise ValueError(f"seeds: got {len(seeds)}, expected at least 4: half to choose deadlines, half to judge them")
