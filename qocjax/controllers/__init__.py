"""Controllers: from sampled poses and ages to commands."""

from qocjax.controllers.apf import Apf, apf
from qocjax.controllers.interface import Controller, Sight, Task

__all__ = ["Apf", "Controller", "Sight", "Task", "apf"]
