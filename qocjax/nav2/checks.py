"""What Nav2 refuses in a parameter file, or takes without effect, beyond types."""

from __future__ import annotations

from collections.abc import Mapping

from qocjax.nav2.document import Document, Found

__all__ = ["LIMITS", "check_limits", "qos_remarks"]

LIMITS = ("max_velocity", "min_velocity", "max_accel", "max_decel")
"""Lists of the velocity smoother: x, y, turn; or six numbers, from Lyrical on."""

_SIGNS = {"max_accel": (1.0, "above", "below"), "max_decel": (-1.0, "below", "above")}
_POLICIES = ("history", "depth", "reliability", "durability")


def check_limits(limits: Mapping[str, Found | None], document: Document) -> None:
    """Checks the limits of a velocity smoother, lists of numbers, of a file.

    Raises:
        ValueError: Of another length than max_velocity (3 where the file has none), accelerations of the wrong sign,
            which Nav2 refuses, or such that the robot cannot change its speed; one line with file and line.
    """
    length = len(_numbers(limits["max_velocity"]) or (0.0,) * 3)
    for name, found in limits.items():
        if found is None:
            continue
        numbers = _numbers(found)
        if len(numbers) not in (3, 6) or len(numbers) != length:
            raise document.fail(found.line, f"{name}: got {len(numbers)} numbers, expected 3 (x, y, turn) or 6, as "
                                "many for all limits")  # fmt: skip
        if name not in _SIGNS:
            continue
        sign, right, wrong = _SIGNS[name]
        if any(sign * each < 0 for each in numbers):
            raise document.fail(found.line, f"{name}: got {numbers}, expected none {wrong} 0")
        if not (numbers[0] and numbers[-1]):
            raise document.fail(found.line, f"{name}: got {numbers}, expected x and turn {right} 0, or the robot "
                                "cannot change its speed")  # fmt: skip


def _numbers(found: Found | None) -> list[float]:
    return [float(each) for each in found.value] if found is not None and isinstance(found.value, list) else []


def qos_remarks(found: Found) -> list[str]:
    """What an override of QoS does not do in Nav2, which has them from Lyrical on; nothing of other parameters."""
    if not found.name.startswith("qos_overrides."):
        return []
    policy = found.name.rpartition(".")[2]
    if policy not in _POLICIES:
        return [f"{found.name}: Nav2 lets {', '.join(_POLICIES[:-1])} and {_POLICIES[-1]} be overridden, so this does "
                "nothing"]  # fmt: skip
    if policy == "reliability" and found.value == "best_effort" and ".publisher." in found.name:
        return [f"{found.name} is best_effort; Nav2's readers are RELIABLE and take nothing from such a writer"]
    return []
