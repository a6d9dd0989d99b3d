"""The network: how long one loop takes, and whether it completes.

Each sample starts a loop that goes up to the edge, is computed on, and comes down again: T_net = T_UL + T_C + T_DL, all
in seconds, and infinite if a message is lost. It completes if T_net is within the deadline (model, section 4).

- A delay law is the distribution of one of the three: `Constant`, `TruncatedNormal`, `ShiftedGamma`,
  `ShiftedLogNormal`, or a measured one, `Empirical` or `QuantileTable`.
- A loss process says which messages are lost: `IndependentLoss`, or in bursts, `GilbertElliott`.
- A `Leg` is a delay law with a loss process, and a `LoopNetwork` two of them with the compute time in between.
- A `Trace` is the other way to a network: loop times as they were measured, in order. A `ComputedTrace` adds the
  computation where the network alone was measured.
- `DdsNetwork`, in `qocjax.network.dds`, is two ROS 2 topics, BEST_EFFORT or RELIABLE.
- All that the rest of qocjax knows of them is `Network`: loop times of a seed, F(deadline), a name. A new transport
  needs no more than that. `loop_times` draws those of a whole study.
- `completes` is the one comparison of a loop time with a deadline.

`paper_network` and `kth_5g_network` are ready to use; `read_samples`, `read_histogram` and `read_trace` take in
measurements. What a completed or a missed loop does to the robot is in `qocjax.network.schedule`.
"""

from qocjax.network.completion import completes, latest
from qocjax.network.computed_trace import ComputedTrace
from qocjax.network.edge import Edge
from qocjax.network.edge_network import EdgeNetwork, with_edge
from qocjax.network.empirical import Empirical, QuantileTable
from qocjax.network.histograms import read_histogram
from qocjax.network.interface import DelayLaw, Load, LossProcess, Network, Reliability, SharedNetwork, loop_times
from qocjax.network.loop_network import Leg, LoopNetwork
from qocjax.network.loss import GilbertElliott, IndependentLoss
from qocjax.network.parametric import Constant, ShiftedGamma, ShiftedLogNormal, TruncatedNormal
from qocjax.network.presets import kth_5g_network, paper_network
from qocjax.network.readers import read_samples, read_trace
from qocjax.network.trace import Trace, faster_than_measured

__all__ = [
    "ComputedTrace",
    "Constant",
    "DelayLaw",
    "Edge",
    "EdgeNetwork",
    "Empirical",
    "GilbertElliott",
    "IndependentLoss",
    "Leg",
    "Load",
    "LoopNetwork",
    "LossProcess",
    "Network",
    "QuantileTable",
    "Reliability",
    "SharedNetwork",
    "ShiftedGamma",
    "ShiftedLogNormal",
    "Trace",
    "TruncatedNormal",
    "completes",
    "faster_than_measured",
    "kth_5g_network",
    "latest",
    "loop_times",
    "paper_network",
    "read_histogram",
    "read_samples",
    "read_trace",
    "with_edge",
]
