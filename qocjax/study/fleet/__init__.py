"""Fleets: how many robots a network carries, and what they need of it (model, sections 12 and 13)."""

from qocjax.study.fleet.layout import LAYOUTS, Layout
from qocjax.study.fleet.limits import Asked, Crossing, crossing, largest_fleet
from qocjax.study.fleet.point import Point, point_of

__all__ = ["LAYOUTS", "Asked", "Crossing", "Layout", "Point", "crossing", "largest_fleet", "point_of"]
