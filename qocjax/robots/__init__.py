"""Robots: what each makes of a command, and how a wanted velocity becomes its command (model, section 2)."""

from qocjax.robots.acceleration import Acceleration
from qocjax.robots.interface import Command, Gains, Piece, Pose, Robot, pose_from
from qocjax.robots.unicycle import Unicycle, arc, arc_piece

__all__ = [
    "Acceleration",
    "Command",
    "Gains",
    "Piece",
    "Pose",
    "Robot",
    "Unicycle",
    "arc",
    "arc_piece",
    "pose_from",
]
