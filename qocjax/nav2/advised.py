"""Which parameters of Nav2 follow from an advice, and how a file's own caps bound them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from qocjax.advice.advice import Advice
from qocjax.nav2.document import Value
from qocjax.nav2.known import DWB, MPPI, RPP, SHIM
from qocjax.nav2.read import NavParams, Plugin
from qocjax.nav2.write import Change
from qocjax.network.schedule import Rules, split_deadline

__all__ = ["Set", "advised", "horizon", "setting"]

_DT, _STEPS = 0.05, 56  # Nav2's defaults of MPPI: a horizon of 2.8 s
_CAPS = {(MPPI, "vx_max"): 0.5, (MPPI, "vx_min"): -0.35, (MPPI, "wz_max"): 1.9, (RPP, "desired_linear_vel"): 0.5,
         (RPP, "rotate_to_heading_angular_vel"): 1.8, (SHIM, "rotate_to_heading_angular_vel"): 1.8}  # fmt: skip
_UNITS = {"v_max": "m/s", "omega_max": "rad/s"}
_SHOWN = "no advice, all that was driven in the recording; what the robot can do goes here, and into"
_SMOOTHER = {"max_velocity": (0.5, 0.0, 2.5), "min_velocity": (-0.5, 0.0, -2.5)}
_TIMEOUT, _SMOOTHING = 1.0, 20.0  # s, 1/s; Nav2's defaults too


@dataclass(frozen=True)
class Set:
    """The numbers of an advice that have a parameter."""

    tau: float  # s
    deadline: float  # s
    v_max: float  # m/s
    omega_max: float  # rad/s
    hold: float  # s of age after which the robot stops
    why: str  # of the hold
    delay: float  # s until a command acts
    unadvised: tuple[str, ...] = ()  # caps that are no advice, but all that a recording shows of the robot

    def unit(self, *caps: str) -> str:
        """Units of caps, for the comment at a parameter, with a warning where one is no advice."""
        units = ", ".join(_UNITS[cap] for cap in caps)
        shown = [f"robot.{cap}=..." for cap in dict.fromkeys(caps) if cap in self.unadvised]
        return f"{units}; CAUTION: {_SHOWN} {' '.join(shown)}" if shown else units


def setting(advice: Advice, rules: Rules, seen: Mapping[str, float] | None = None) -> Set:
    """The numbers of an advice, with the age at which the robot stops by the rules it was worked out under.

    Args:
        advice: What is advised.
        rules: Actuation and hold.
        seen: Caps that stand for those of the robot as a recording shows no more.
    """
    best = advice.recommended
    tau, deadline, v_max, omega_max = (
        float(np.asarray(getattr(best, name))) for name in ("tau", "deadline", "v_max", "omega_max")
    )
    hold, why = _oldest(float(advice.judged["age_peak_p99"].iloc[-1]), deadline, tau, rules)
    if rules.hold == "timeout":
        hold, why = rules.hold_timeout, "s of age after which the simulated robot stops"
    elif rules.hold == "zero":
        hold, why = deadline + tau, "deadline + tau, the age of a command when the next one is missed"
    middle = advice.character["percentiles_ms"]["p50"] / 1e3
    delay = {"deadline": deadline, "instant": 0.0}.get(rules.actuation, min(middle, deadline))
    caps = {"v_max": v_max, "omega_max": omega_max}
    shown = tuple(name for name, cap in caps.items() if seen and cap >= seen.get(name, math.inf) * (1 - 1e-6))
    return Set(tau, deadline, _rounded(v_max), _rounded(omega_max), _rounded(hold), why, _rounded(delay), shown)


def _oldest(peak: float, deadline: float, tau: float, rules: Rules) -> tuple[float, str]:
    """Age that commands in force reach (s), in whole 50 ms, and what it is; one missed loop is no reason to brake.

    Args:
        peak: Largest age at sampling instants (s), of 99 % of the runs. A command stays in force until the next
            one takes effect, after the next instant.
        deadline: Delta (s).
        tau: Sampling period (s).
        rules: Actuation.
    """
    rest = float(split_deadline(np.float64(deadline), np.float64(tau))[1]) if rules.actuation == "deadline" else 0.0
    oldest, missed = peak + (rest or tau), deadline + 2.0 * tau
    often = f"99 % of the simulated runs had no command older than {oldest:.3g} s"
    why = often if oldest >= missed else f"deadline + 2 tau, for a missed loop; {often}"
    return math.ceil(round(max(oldest, missed) * 20, 6)) / 20, why


def horizon(plugin: Plugin | None) -> float:
    """How far the rollouts of MPPI look ahead (s)."""
    return _of(plugin, "model_dt", _DT) * _of(plugin, "time_steps", _STEPS)


def advised(
    best: Set,
    params: NavParams | None = None,
    simulated: Mapping[str, Value] | None = None,
    tuned: Mapping[str, float] | None = None,
) -> list[Change]:
    """The parameters to set.

    Args:
        best: What is advised.
        params: The user's file, whose caps are not raised: a robot that it keeps slower stays slower. None for
            parameters without a file, of MPPI under the name FollowPath.
        simulated: What the stack that the advice was worked out with has otherwise than Nav2, of `stack_values`; read
            without a file.
        tuned: What is advised of the stack, by names of the configuration.
    """
    found = [Change("controller_server", "controller_frequency", 1.0 / best.tau, "1 / tau (1/s)")]
    for plugin in params.controllers if params else (Plugin("FollowPath", MPPI, simulated or {}),):
        found += _controller(best, plugin, params is not None)
    for shim in params.shims if params else ():
        name = "rotate_to_heading_angular_vel"
        found.append(_cap(shim, name, best.omega_max, True, best.unit("omega_max")))
    found += _tuned(tuned or {}, params)
    if params is None:
        done = {change.name for change in found}
        found += [Change("controller_server", f"FollowPath.{name}", value, "as simulated")
                  for name, value in (simulated or {}).items() if f"FollowPath.{name}" not in done]  # fmt: skip
    return [*found, *_smoother(best, params), *_base(best, params)]


def _tuned(tuned: Mapping[str, float], params: NavParams | None) -> Iterator[Change]:
    """What is advised of MPPI, its critics, the inflation and the tolerance of the goal; the rest has no parameter."""
    controllers = params.controllers if params else (Plugin("FollowPath", MPPI, {}),)
    inflation = (params and params.inflation) or Plugin("inflation_layer", "", {})
    goal = (params and params.goal) or Plugin("general_goal_checker", "", {})
    for name, value in tuned.items():
        part, _, own = name.removeprefix("controller.").partition(".")
        if part == "mppi":
            for plugin in (each for each in controllers if each.kind == MPPI):
                yield _set(plugin, own.removeprefix("critics."), _rounded(value), "as advised")
        elif part == "inflation":
            for node in ("local_costmap/local_costmap", "global_costmap/global_costmap"):
                yield Change(node, f"{inflation.name}.{own}", _rounded(value), "as advised, in both costmaps")
        elif part == "xy_goal_tolerance":
            yield _set(goal, part, _rounded(value), "m, as advised")


def _controller(best: Set, plugin: Plugin, file: bool) -> Iterator[Change]:
    """Step, horizon and caps of a controller."""
    if plugin.kind == MPPI:
        yield from _rollouts(best, plugin, file)
        yield _cap(plugin, "vx_max", best.v_max, file, best.unit("v_max"))
        if -_of(plugin, "vx_min", -0.35) > best.v_max:
            yield _set(plugin, "vx_min", -best.v_max, "m/s; or the robot would pass the cap backwards")
        yield _cap(plugin, "wz_max", best.omega_max, file, best.unit("omega_max"))
    elif plugin.kind == DWB:
        v, omega = best.unit("v_max"), best.unit("omega_max")
        for name, cap, unit in (("max_vel_x", best.v_max, v), ("max_speed_xy", best.v_max, v),
                                ("max_vel_theta", best.omega_max, omega)):  # fmt: skip
            yield _cap(plugin, name, cap, file, unit)
        if -_of(plugin, "min_vel_x", 0.0) > best.v_max:
            yield _set(plugin, "min_vel_x", -best.v_max, "m/s; or the robot would pass the cap backwards")
    else:
        new = "max_linear_vel" in plugin.values and "desired_linear_vel" not in plugin.values
        yield _cap(plugin, "max_linear_vel" if new else "desired_linear_vel", best.v_max, file, best.unit("v_max"))
        yield _cap(plugin, "rotate_to_heading_angular_vel", best.omega_max, True, best.unit("omega_max"))
        if "max_angular_vel" in plugin.values:
            yield _cap(plugin, "max_angular_vel", best.omega_max, file, best.unit("omega_max"))
        for name, cap in (("min_linear_vel", best.v_max), ("min_angular_vel", best.omega_max)):
            if -_of(plugin, name, 0.0) > cap:
                yield _set(plugin, name, -cap, "or the robot would pass the cap the other way")


def _rollouts(best: Set, plugin: Plugin, file: bool) -> Iterator[Change]:
    """Step and number of steps of MPPI, with the horizon kept, and its delay where the file has one.

    Nav2 refuses a period above model_dt and warns of one below it: the step stays where the period is shorter, as a
    shorter step would take the rollouts' end with it.
    """
    step, ahead = _of(plugin, "model_dt", _DT), horizon(plugin)
    if best.tau > step * (1 + 1e-6):
        steps = max(1, round(ahead / best.tau))
        yield _set(plugin, "model_dt", best.tau, "s; no shorter than the period, which Nav2 refuses")
        yield _set(plugin, "time_steps", steps, f"of model_dt, so that the horizon stays {ahead:.3g} s")
    elif not file:
        yield _set(plugin, "model_dt", step, "s; Nav2 takes a period as long or shorter")
        yield _set(plugin, "time_steps", round(ahead / step), f"of model_dt, a horizon of {ahead:.3g} s")
    if best.tau > step * (1 - 1e-6):  # Nav2 keeps the commands under way by the cycle, and counts the delay in steps
        for name in ("model_delay_vx", "model_delay_wz"):
            if name in plugin.values:
                yield _set(plugin, name, best.delay, "s until a command acts, in whole steps of model_dt")


def _smoother(best: Set, params: NavParams | None) -> Iterator[Change]:
    """Caps, rate and timeout of the velocity smoother."""
    node, caps = "velocity_smoother", (best.v_max, best.omega_max)
    for name, sign in (("max_velocity", 1.0), ("min_velocity", -1.0)):
        given = params and params.limits(name)
        limits = list(given or _SMOOTHER[name])
        for k, cap in zip((0, -1), caps, strict=True):
            free = params is None and (k == -1 or sign > 0)  # without a file, backwards no faster than Nav2's default
            limits[k] = sign * (cap if free else min(cap, abs(limits[k])))
        yield Change(node, name, limits, best.unit(*["v_max"] * (len(limits) - 1), "omega_max"))
    rate = params and params.number(node, "smoothing_frequency") or _SMOOTHING
    if 1.0 / best.tau > rate * (1 + 1e-6):
        yield Change(node, "smoothing_frequency", 1.0 / best.tau, "1/s; or commands would wait for its next turn")
    limit = params and params.number(node, "velocity_timeout") or _TIMEOUT
    why = f"s; {best.why}" + ("" if best.hold <= limit else f"; stays {limit:.3g}, so the robot stops earlier")
    yield Change(node, "velocity_timeout", min(best.hold, limit), why)


def _base(best: Set, params: NavParams | None) -> Iterator[Change]:
    """Timeout of the base controller, where the file holds its parameters; there 0 is never."""
    for (node, name), value in (params.values if params else {}).items():
        if name == "cmd_vel_timeout" and isinstance(value, float) and (value == 0.0 or value > best.hold):
            own = node.split("/")[len(params.namespace) if params else 0 :]
            yield Change("/".join(own), name, best.hold, f"s; {best.why}")


def _cap(plugin: Plugin, name: str, cap: float, file: bool, unit: str) -> Change:
    """A cap, no higher than the file's own or, where it says nothing, than Nav2's default."""
    own = _of(plugin, name, _CAPS.get((plugin.kind, name), cap) if file else cap)
    return _set(plugin, name, min(own, cap) if own else cap, unit)


def _set(plugin: Plugin, name: str, value: Value, why: str) -> Change:
    return Change("controller_server", f"{plugin.name}.{name}", value, why)


def _of(plugin: Plugin | None, name: str, default: float) -> float:
    value = plugin.values.get(name, default) if plugin else default
    return float(value) if isinstance(value, (int, float)) else default


def _rounded(value: float) -> float:
    """Four digits, as a file shows them."""
    return float(f"{value:.4g}")
