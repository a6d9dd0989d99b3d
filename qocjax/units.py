"""Units of metrics and of the values of a design."""

from __future__ import annotations

from qocjax.tunables import APF, CBF, LOOP, NAVIGATION, NETWORK, ROBOT, by_name

__all__ = ["UNITS", "printed_unit", "unit_of"]

UNITS = {
    "auc": "s", "path_length": "m", "effort": "(m/s)^2 s + (rad/s)^2 s", "arrival_time": "s", "min_distance": "m",
    "collided": "1", "completed_share": "1", "age_mean": "s", "age_peak": "s",
    "no_path_share": "1", "blocked_share": "1",
    "v_max": "m/s", "omega_max": "rad/s", "eta": "1", "kappa": "1/s", "gamma": "1/s", "c_miss": "m/s", "d_safe": "m",
    "tau": "s", "deadline": "s",
}  # fmt: skip

_DECLARED = {name: each.unit for name, each in by_name((*ROBOT, *LOOP, *NETWORK, *APF, *CBF, *NAVIGATION)).items()}


def unit_of(name: str) -> str:
    """Unit of a metric, of a value of a design, or of a derivative d_auc_<value>."""
    if name.startswith("d_auc_"):
        return f"{UNITS['auc']}/({UNITS[name.removeprefix('d_auc_')]})"
    return UNITS.get(name) or _DECLARED.get(name, "1")  # what controllers report of themselves are shares and counts


def printed_unit(name: str) -> str:
    """Unit of a value of a design, as it follows the number; nothing where it is a plain number."""
    unit = unit_of(name)
    return "" if unit == "1" else unit
