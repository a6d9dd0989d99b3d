"""Controllers: from sampled poses and ages to commands."""

from qocjax.controllers.apf import apf

__all__ = ["apf"]
