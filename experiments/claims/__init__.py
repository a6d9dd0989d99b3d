"""Tests of what the paper says: of its curves, of its policies, of each parameter.

Each takes a bench and gives differences with the bounds that are claimed for them (`experiments/verdicts.py`). They are
paired over seeds; what is compared (best values, best deadlines, designs of the policies) was chosen on other seeds.
The bounds ask for 1 % of AUC or 0.0025 of QoC (the same at QoC = 1/2): less is no effect, however many seeds could show
it. QoC is on the scale of each study, taken as given.
"""

from __future__ import annotations

from collections.abc import Callable

from experiments.settings import Bench
from experiments.verdicts import Finding

LEAST = 0.01  # of the baseline's AUC at its best deadline: the smallest effect that counts
LEAST_QOC = LEAST / 4  # the same at QoC = 1/2, where dQ = -dJ/J / 4
LEAST_TIME = 0.05  # s, 1 % of the way at full speed
LEAST_DISTANCE = 0.01  # m
COLLISIONS = 0.05  # share of runs with robots closer than two radii that a design may have
RELIABLE = 0.5  # share of loops: more complete than are missed
LATE = (600, 700, 800)  # ms, high delays

Test = Callable[[Bench], Finding]
