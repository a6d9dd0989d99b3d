"""The loop of the model on a real robot: nodes of ROS 2 that hold commands to a deadline and carry stamps.

    gate = DeadlineGate(Rules(hold="zero"), deadline=0.2, period=0.05)
    gate.arrive(stamp, (0.3, 0.1), now)  # times in ns
    gate.advance(now)  # what changed until now, each change at its own time

`gate`, `loops` and `hold` say which command is in force when, `injection` delays commands as a network would, `pairing`
finds the pose that a command answers. None of them needs ROS; `deadline` and `stamps` are the nodes around them.
"""

from qocjax.ros.gate import Change, Counts, DeadlineGate
from qocjax.ros.injection import Injection, drawn_loop_times
from qocjax.ros.pairing import Pair, Pairing

__all__ = ["Change", "Counts", "DeadlineGate", "Injection", "Pair", "Pairing", "drawn_loop_times"]
