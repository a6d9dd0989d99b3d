"""One 5G cell whose air is shared by all robots (model, section 13).

`Frame` says which slot serves which direction, `OtherTraffic` what others leave of them, `through_air` when messages
have left the air, first come first served. `CellNetwork` is the network: uplink, edge, downlink.
"""

from qocjax.network.cell.cell_network import CellNetwork
from qocjax.network.cell.direction import Access, Direction
from qocjax.network.cell.frame import Frame
from qocjax.network.cell.traffic import OtherTraffic

__all__ = ["Access", "CellNetwork", "Direction", "Frame", "OtherTraffic"]
