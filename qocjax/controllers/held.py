"""Large arrays of a controller as arguments of a program, not as constants in it."""

from __future__ import annotations

from typing import Any

from qocjax.controllers.interface import Controller

__all__ = ["held", "holding"]


def held(controller: Controller) -> Any:
    """The arrays, of a controller that has some; else nothing."""
    return controller.held() if hasattr(controller, "held") else ()


def holding(controller: Controller, arrays: Any) -> Controller:
    """The controller with these arrays, of the same shapes, in the place of its own."""
    return controller.holding(arrays) if hasattr(controller, "holding") else controller
