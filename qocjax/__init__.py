"""qocjax: quality of control for robots that are steered from the edge over a wireless network.

    run = qocjax.simulate(qocjax.Scenario(), qocjax.Design(deadline=0.2), loop_times)
    designs = qocjax.Design(kappa=[1.0, 2.0, 3.0])
    metrics = qocjax.evaluate(qocjax.Scenario(), designs, qocjax.paper_network(), range(32))

The story by module: `scenario` (what is simulated, what one may choose), `tunables` (what the parts declare), `robots`
(how they move), `controllers` and `navigation` (laws), `network` (loop times, completion, age), `closed_loop` (one
tick, one scan), `quality` and `reference` (AUC and QoC), `batch` (many designs x seeds), `study` (grids in chunks,
policies), `search`, `tuning`, `advice`, `fleets`, `transport` and `validation` (what else is asked), `statistics`,
`store`, `figures` and `report` (intervals, files, pictures, pages), `commands` (the command lines).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from qocjax._lazy import names_of

if TYPE_CHECKING:
    from qocjax.batch.evaluate import evaluate
    from qocjax.batch.gradient import gradient
    from qocjax.network import Network, kth_5g_network, paper_network, read_trace
    from qocjax.network.schedule import Rules
    from qocjax.quality import QocScale, qoc
    from qocjax.robots import Acceleration, Robot, Unicycle
    from qocjax.scenario import Design, Scenario
    from qocjax.single import Run, simulate
    from qocjax.study import Study, one_at_a_time, open_study, replay, run_study

__version__ = "0.1.0"

__all__ = [
    "Acceleration",
    "Design",
    "Network",
    "QocScale",
    "Robot",
    "Rules",
    "Run",
    "Scenario",
    "Study",
    "Unicycle",
    "evaluate",
    "gradient",
    "kth_5g_network",
    "one_at_a_time",
    "open_study",
    "paper_network",
    "qoc",
    "read_trace",
    "replay",
    "run_study",
    "simulate",
]

if not TYPE_CHECKING:  # imported when asked for: a command that refuses an option has no need of what computes
    _HOMES = {
        "qocjax.batch": ("evaluate", "gradient"),
        "qocjax.network": ("Network", "kth_5g_network", "paper_network", "read_trace"),
        "qocjax.network.schedule": ("Rules",),
        "qocjax.quality": ("QocScale", "qoc"),
        "qocjax.robots": ("Acceleration", "Robot", "Unicycle"),
        "qocjax.scenario": ("Design", "Scenario"),
        "qocjax.single": ("Run", "simulate"),
        "qocjax.study": ("Study", "one_at_a_time", "open_study", "replay", "run_study"),
    }
    __getattr__, __dir__ = names_of(__name__, _HOMES)
