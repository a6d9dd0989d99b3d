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

from qocjax.batch import evaluate, gradient
from qocjax.network import Network, kth_5g_network, paper_network, read_trace
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale, qoc
from qocjax.robots import Acceleration, Robot, Unicycle
from qocjax.scenario import Design, Scenario
from qocjax.simulate import Run, simulate
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
