"""When a claim holds: differences with their intervals, each beyond a bound or not.

A claim *holds* where the 95 % interval of every difference lies on the right side of its bound, is *contradicted* where
that of one (of m, at 1 - 0.05/m) lies on the wrong side (shown to be less than counts is contradicted too), and
*undecided* else. Of a claim that something *can* happen one difference (of m, at 1 - 0.05/m) has to lie on the right
side, and it is contradicted where all lie on the wrong one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special

from qocjax.statistics.estimates import Estimate, estimate


class Unit(NamedTuple):
    """How numbers are shown: J* is the baseline's AUC at its best deadline."""

    name: str
    scale: float
    form: str

    def text(self, value: float) -> str:
        """A number in this unit, zero without a sign."""
        text = format(self.scale * value, self.form)
        return text if float(text) else text.lstrip("+-")


UNITS = {
    "J*": Unit("% of J*", 100.0, "+.1f"),
    "spread": Unit("%", 100.0, "+.1f"),
    "share": Unit("%", 100.0, ".1f"),
    "times": Unit("times", 1.0, ".0f"),
    "QoC": Unit("QoC", 1.0, "+.4f"),
    "m": Unit("m", 1.0, "+.3f"),
    "s": Unit("s", 1.0, "+.2f"),
    "ms": Unit("ms", 1.0, "+.0f"),
    "1/s": Unit("1/s", 1.0, "+g"),
}


@dataclass(frozen=True)
class Part:
    """A difference by seed [S], or whether something happened [S], and the side of a bound that is claimed for it.

    A choice, which has no seeds, is one number.
    """

    what: str
    values: np.ndarray
    unit: str  # of `UNITS`
    bound: float
    above: bool = True

    def interval(self, confidence: float = 0.95) -> Estimate:
        """Mean with its interval: Student's, and Wilson's for shares."""
        if np.ndim(self.values) == 0:
            return Estimate(float(self.values), 0.0, float(self.values), float(self.values))
        if self.values.dtype != bool:
            return estimate(self.values, confidence)
        share, count = float(self.values.mean()), self.values.size
        z2 = float(special.ndtri(0.5 + confidence / 2)) ** 2
        middle, half = share + z2 / (2 * count), np.sqrt(z2 * (share * (1 - share) / count + z2 / (4 * count**2)))
        se = float(np.sqrt(share * (1 - share) / count))
        return Estimate(share, se, *((middle + sign * half) / (1 + z2 / count) for sign in (-1, 1)))

    def room(self) -> float:
        """Standard errors from the bound, negative on the wrong side."""
        found = self.interval()
        gap = (found.mean - self.bound) * (1 if self.above else -1)
        half = (found.high - found.low) / 2
        return gap / half if half > 0 else np.copysign(np.inf, gap if gap else -1.0)

    def side(self, confidence: float = 0.95) -> int:
        """1 where the interval lies on the right side of the bound, -1 on the wrong one, 0 across it."""
        found = self.interval(confidence)
        if found.low == found.high == self.bound:  # a choice at its bound: nothing of what is claimed
            return -1
        side = int(found.low > self.bound) - int(found.high < self.bound)
        return side if self.above else -side

    def text(self) -> str:
        """What it came to, for a reader."""
        found, shown = self.interval(), UNITS[self.unit]
        mean, low, high = map(shown.text, (found.mean, found.low, found.high))
        ends = "" if np.ndim(self.values) == 0 else f" [{low}, {high}]"
        return f"{self.what}: {mean}{ends} {shown.name}".rstrip()


@dataclass(frozen=True)
class Finding:
    """What became of a claim; its parts are judged together."""

    parts: list[Part]
    note: str = ""
    some: bool = False  # whether it is claimed that something can happen: one part is enough

    @property
    def verdict(self) -> str:
        """`holds`, `contradicted` or `undecided`."""
        each = 1 - 0.05 / len(self.parts)
        right, wrong = (0.95, each) if not self.some else (each, 0.95)
        every, one = (any, all) if self.some else (all, any)
        if every(part.side(right) > 0 for part in self.parts):
            return "holds"
        return "contradicted" if one(part.side(wrong) < 0 for part in self.parts) else "undecided"

    @property
    def deciding(self) -> Part:
        """The difference nearest to its bound or farthest beyond it; of what can happen, farthest on the right side."""
        return (max if self.some else min)(self.parts, key=Part.room)

    @property
    def shown(self) -> list[Part]:
        """Of each unit the difference that decides, in their order."""
        kinds = dict.fromkeys(part.unit for part in self.parts)
        return [Finding([p for p in self.parts if p.unit == unit], some=self.some).deciding for unit in kinds]


def ratio(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """[S] Values whose mean is the ratio of the means, and whose spread is, to first order, that of the ratio."""
    share = upper.mean() / lower.mean()
    return share + (upper - share * lower) / lower.mean()
