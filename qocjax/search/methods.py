"""The methods by name. Each is a function of a trial: it asks for points until their simulations are spent."""

from __future__ import annotations

from collections.abc import Callable

from qocjax.search.ascent import ascent_from
from qocjax.search.cma import cma_es
from qocjax.search.halving import sobol_halving
from qocjax.search.random_points import random_points
from qocjax.search.trial import Trial

__all__ = ["METHODS", "Method"]

Method = Callable[[Trial], None]

METHODS: dict[str, Method] = {
    "random": random_points,
    "sobol": sobol_halving,
    "cma_es": cma_es,
    "sobol_gradient": ascent_from(sobol_halving),
    "cma_gradient": ascent_from(cma_es),
}
