"""Networks ready to use: the paper's, and one measured on a private 5G network."""

from __future__ import annotations

from functools import cache
from importlib import resources

from qocjax.network.columns import read_columns
from qocjax.network.empirical import QuantileTable
from qocjax.network.loop_network import Leg, LoopNetwork
from qocjax.network.loss import IndependentLoss
from qocjax.network.parametric import TruncatedNormal

__all__ = ["kth_5g_network", "paper_network"]


def paper_network(mean: float = 0.20, std: float = 0.05) -> LoopNetwork:
    """Returns the network of the paper's simulation: compute alone takes time, TruncNormal on [0, inf).

    Paper, simulation parameters; model, section 1.

    Args:
        mean: Mean of the compute time before truncation (s).
        std: Its standard deviation before truncation (s).

    Raises:
        ValueError: A number is out of range.
    """
    return LoopNetwork(compute=TruncatedNormal(mean, std), name="paper")


def kth_5g_network(
    mean: float = 0.20, std: float = 0.05, uplink_loss: float = 0.0, downlink_loss: float = 0.0
) -> LoopNetwork:
    """Returns one-way delays measured on a private 5G network at KTH, around the paper's compute time.

    The delays are independent draws from the quantiles in `tables/kth_5g.csv`, whose README names the measurement; it
    had no losses to take over.

    Args:
        mean: Mean of the compute time before truncation (s).
        std: Its standard deviation before truncation (s).
        uplink_loss: Probability that an uplink message is lost.
        downlink_loss: Probability that a downlink message is lost.

    Raises:
        ValueError: A number is out of range.
    """
    return LoopNetwork(
        uplink=Leg(_kth_5g("uplink"), IndependentLoss(uplink_loss)),
        compute=TruncatedNormal(mean, std),
        downlink=Leg(_kth_5g("downlink"), IndependentLoss(downlink_loss)),
        name="kth_5g",
    )


@cache  # one object, so that networks that share it compile once
def _kth_5g(direction: str) -> QuantileTable:
    with resources.as_file(resources.files("qocjax.network") / "tables" / "kth_5g.csv") as path:
        table = read_columns(path, ["probability", direction])
    source = f"KTH private 5G, {direction} (Sharma et al., IEEE Access 11, 2023)"
    return QuantileTable(table.numbers("probability"), table.delays(direction, "s"), source)
