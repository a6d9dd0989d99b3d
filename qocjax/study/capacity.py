"""What a study takes for granted of network and edge, in words: computations at once, and queues that never end."""

from __future__ import annotations

import numpy as np

from qocjax.network.cell import CellNetwork
from qocjax.network.computing import computations_at_once
from qocjax.network.edge import Edge
from qocjax.network.interface import Load, Network
from qocjax.study.problem import Problem
from qocjax.study.reliability import load_of
from qocjax.study.study import Study

__all__ = ["at_once_text", "edge_text", "offered_load", "overload_texts", "usual_load"]


def usual_load(study: Study, problem: Problem) -> tuple[Load, float]:
    """The load at the sampling period that most designs of a study have, and the deadline of its best choice (s)."""
    tau = float(study.results["tau"].value_counts().index[0])
    best = study.policies.loc[study.policies["qoc"].idxmax()]
    return load_of(problem.scenario, tau), float(best["deadline"])


def at_once_text(network: Network, load: Load, deadline: float) -> str:
    """A line on how many computations at once a network has under way, of all robots together."""
    found = computations_at_once(network, load, deadline)
    if found is None:
        return f"{network.name}: it does not tell how many computations it had under way at once."
    edge = getattr(network, "edge", None)
    total = np.inf if edge is None else edge.total(load.num_robots)
    limit = "an edge without limit"
    if edge is not None and np.isfinite(total):
        limit = f"{total:g} worker{'' if total == 1 else 's'} ({edge.discipline})"
    robots = f"{load.num_robots} robot{' has' if load.num_robots == 1 else 's have'}"
    mean, peak = _count(found.mean), _count(found.peak)
    return (
        f"At τ = {1e3 * load.tau:g} ms {robots} {mean} computations under way at once in the mean, {peak} at the peak, "
        f"on {limit}."
    )


def offered_load(network: Network, load: Load) -> dict[str, float]:
    """What is offered to each thing that is scarce, as a share of what it can serve; nothing where nothing is.

    Of the edge that is the erlangs of computing that each worker is offered, were every sample to reach it.

    Args:
        network: Where loops come from.
        load: What it carries.
    """
    found: dict[str, float] = {}
    edge, samples = getattr(network, "edge", None), load.num_robots / load.tau  # 1/s
    law = getattr(getattr(network, "path", network), "compute", None)
    computed = samples
    if edge is not None and edge.finite and law is not None:
        mean = float(np.mean(law.quantile((np.arange(2000) + 0.5) / 2000)))
        found["edge"] = samples * mean / edge.total(load.num_robots)
        computed = samples / max(found["edge"], 1.0)
    if isinstance(network, CellNetwork):
        for way, messages in (("uplink", samples), ("downlink", computed)):
            slots = getattr(network, way).mean_size(network.harq_max)
            found[way] = messages * slots / network.free_slots_per_s(way)
    return found


def edge_text(edge: Edge, num_robots: int) -> str:
    """How many workers there are, and whose."""
    if not edge.finite:
        return "edge: workers without limit"
    workers = f"edge: {edge.workers} worker{'' if edge.workers == 1 else 's'}"
    return f"{workers} for each robot ({edge.total(num_robots):g} in all)" if edge.per_robot else f"{workers} shared"


def overload_texts(network: Network, load: Load, deadline: float) -> list[str]:
    """A line for each queue that is offered more than it can serve: its delay grows without bound.

    Args:
        network: Where loops come from.
        load: What it carries.
        deadline: Delta (s), for which it is said when the queue alone passes it.
    """
    edge = getattr(network, "edge", None)
    # Other disciplines drop what finds no worker, and of a finite edge only what was computed goes down.
    grows = {"uplink": "the uplink of the cell"}
    grows |= {"edge": "the edge (fifo)"} if edge is not None and edge.discipline == "fifo" and not edge.abort else {}
    grows |= {} if edge is not None and edge.finite else {"downlink": "the downlink of the cell"}
    found = offered_load(network, load)
    offered = {text: found[name] for name, text in grows.items() if name in found}
    return [
        f"{what} is offered {share:.0%} of what it can serve: delay grows without bound, by {share - 1.0:.2g} s a "
        f"second, and passes {1e3 * deadline:g} ms after {deadline / (share - 1.0):.2g} s"
        for what, share in offered.items()
        if share > 1.0
    ]


def _count(number: float) -> str:
    return f"{number:.0f}" if number >= 10 else f"{number:.2g}"
