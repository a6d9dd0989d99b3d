"""Robots: what each makes of a command, and how a wanted velocity becomes its command (model, section 2)."""

from qocjax.robots.acceleration import Acceleration, Part, linear_piece
from qocjax.robots.ackermann import Ackermann
from qocjax.robots.holonomic import Holonomic, glide
from qocjax.robots.interface import Command, Gains, Piece, Pose, Robot, pose_from
from qocjax.robots.unicycle import Unicycle, arc, arc_piece

__all__ = [
    "Acceleration",
    "Ackermann",
    "Command",
    "Gains",
    "Holonomic",
    "Part",
    "Piece",
    "Pose",
    "Robot",
    "Unicycle",
    "arc",
    "arc_piece",
    "glide",
    "linear_piece",
    "pose_from",
]
