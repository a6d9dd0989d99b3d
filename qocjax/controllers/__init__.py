"""Controllers: from sampled poses and ages to commands."""

from qocjax.controllers.apf import Apf, apf
from qocjax.controllers.cbf import Cbf
from qocjax.controllers.interface import Controller, Sight, Task
from qocjax.controllers.law import Law

__all__ = ["Apf", "Cbf", "Controller", "Law", "Sight", "Task", "apf"]
