"""Plants that are no robots, in the same loop: linear ones, for which the truth is known."""

from qocjax.plants.linear import LinearPlant
from qocjax.plants.linear_runs import LinearRun, evaluate_linear, simulate_linear

__all__ = ["LinearPlant", "LinearRun", "evaluate_linear", "simulate_linear"]
