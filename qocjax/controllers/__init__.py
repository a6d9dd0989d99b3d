"""Controllers: from sampled poses and ages to commands."""

from qocjax.controllers.apf import Apf, apf
from qocjax.controllers.cbf import Cbf
from qocjax.controllers.interface import Controller, Sight, Task

__all__ = ["Apf", "Cbf", "Controller", "Sight", "Task", "apf"]
