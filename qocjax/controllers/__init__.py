"""Controllers: from sampled poses and ages to commands."""

from qocjax.controllers.apf import Apf, apf
from qocjax.controllers.cbf import Cbf
from qocjax.controllers.interface import Controller, Sight, Task
from qocjax.controllers.law import Law
from qocjax.controllers.rolled import PlanMaker, plan_of

__all__ = ["Apf", "Cbf", "Controller", "Law", "PlanMaker", "Sight", "Task", "apf", "plan_of"]
