"""Fleets: how many robots a network carries, and what they need of it (model, sections 12 and 13)."""

from qocjax.fleets.layout import LAYOUTS, Layout
from qocjax.fleets.limits import Asked, Crossing, crossing, largest_fleet
from qocjax.fleets.point import Point, point_of

__all__ = ["LAYOUTS", "Asked", "Crossing", "Layout", "Point", "crossing", "largest_fleet", "point_of"]
