"""Plants that are no robots, in the same loop: linear ones, for which the truth is known, and a cart with a pole."""

from qocjax.plants.cart_pole import CartPole, cleave_cart_pole, simulate_cart_pole
from qocjax.plants.linear import LinearPlant
from qocjax.plants.linear_runs import LinearRun, evaluate_linear, simulate_linear

__all__ = [
    "CartPole",
    "LinearPlant",
    "LinearRun",
    "cleave_cart_pole",
    "evaluate_linear",
    "simulate_cart_pole",
    "simulate_linear",
]
