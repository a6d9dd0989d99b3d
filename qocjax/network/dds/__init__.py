"""ROS 2 transport: BEST_EFFORT and RELIABLE between a robot and the edge, loop by loop (model, section 8).

- `Profile` is the QoS of a topic with its protocol timers, `TIMERS` these by middleware, `Topic` a direction with one.
- `DdsNetwork` is the network: two topics and the compute between them. `draw` gives loop times as every network does,
  `loops` their parts and the traffic; `with_qos` changes the QoS of both topics.
- `loop_statistics` says how loops went: percentiles, losses, age of the newest command, throughput.
"""

from qocjax.network.dds.dds_network import DdsNetwork, Loops
from qocjax.network.dds.profile import TIMERS, Profile
from qocjax.network.dds.statistics import loop_statistics
from qocjax.network.dds.transport import Topic, Traffic, per_second

__all__ = ["TIMERS", "DdsNetwork", "Loops", "Profile", "Topic", "Traffic", "loop_statistics", "per_second"]
