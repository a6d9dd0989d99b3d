"""An advice in Nav2 and ROS 2 names, where a parameter has a counterpart there."""

from __future__ import annotations

import math

import numpy as np

from qocjax.network.schedule import Rules
from qocjax.study.advice import Advice

__all__ = ["nav2_text"]

_TIMEOUT = 1.0  # s, Nav2's own default of velocity_timeout
_GAINS = {"kappa": "1/s", "gamma": "1/s", "eta": "", "c_miss": "m/s", "d_safe": "m"}


def nav2_text(advice: Advice, rules: Rules) -> str:
    """A parameter fragment in Nav2 and ROS 2 names, with comments on what has no counterpart there."""
    best = advice.recommended
    tau, deadline, v_max, omega_max = (
        float(np.asarray(getattr(best, n))) for n in ("tau", "deadline", "v_max", "omega_max")
    )
    peak = float(advice.judged["age_peak_p99"].iloc[-1])
    hold = rules.hold_timeout if rules.hold == "timeout" else math.ceil(peak * 20) / 20
    timeout = min(hold, _TIMEOUT)
    gap = math.ceil((advice.character["p99_miss_run"] + 1) * tau * 1e3) * 1_000_000
    why = f"99 % of the simulated runs had no command older than {peak:.2f} s"
    if hold > _TIMEOUT:
        why += "; Nav2's default, shorter: the robot then stops where the simulated one went on"
    frequency = f"{1 / tau:.6g}"
    values = {name: float(np.asarray(getattr(best, name))) for name in _GAINS}
    gains = [f"#   {name}: {value:.4g} {_GAINS[name]}".rstrip() for name, value in values.items()]
    return _NAV2.format(
        name=advice.network.get("name", ""), deadline_ms=f"{1e3 * deadline:.4g}", tau_ms=f"{1e3 * tau:.4g}",
        share=advice.character["reliability"], frequency=frequency if "." in frequency else frequency + ".0", tau=tau,
        v_max=v_max, omega_max=omega_max, timeout=timeout, why=why, lifespan=round(deadline * 1e9), gap=gap,
        gap_ms=gap // 1_000_000, run=advice.character["p99_miss_run"], gains="\n".join(gains),
    )  # fmt: skip


_NAV2 = """\
# From qocjax.advise, for the network {name!r}: deadline {deadline_ms} ms, by which {share:.1%} of the loops complete,
# at a sampling period of {tau_ms} ms. To be merged into nav2_params.yaml.

controller_server:
  ros__parameters:
    controller_frequency: {frequency}  # 1 / tau
    FollowPath:
      # MPPI; for DWB: max_vel_x, max_speed_xy and max_vel_theta
      model_dt: {tau:g}  # MPPI wants 1 / controller_frequency
      vx_max: {v_max:.4g}
      wz_max: {omega_max:.4g}

velocity_smoother:
  ros__parameters:
    max_velocity: [{v_max:.4g}, 0.0, {omega_max:.4g}]
    velocity_timeout: {timeout:.2f}  # s; {why}

# ROS 2 QoS, in nanoseconds. It takes effect where a node lets its QoS be overridden by parameters (qos_overrides; in
# Nav2 from Lyrical on, with allow_parameter_qos_overrides); else set it in code.
#   lifespan: a command older than the deadline is of no use. It counts for one topic, from the writer on; the deadline
#     covers the whole loop, uplink, compute and downlink, so this is its upper limit.
#   deadline: not the loop's deadline, but the longest time between two messages: {gap_ms} ms, as 99 % of the runs of
#     misses are no longer than {run} loops. A reader asks for no less than the writer offers.
#
# controller_server:
#   ros__parameters:
#     qos_overrides:
#       /cmd_vel:
#         publisher:
#           reliability: best_effort
#           history: keep_last
#           depth: 1
#           lifespan: {lifespan}
#           deadline: {gap}

# Without a counterpart in Nav2:
#   deadline: {deadline_ms} ms. A loop that takes longer is given up, and a command takes effect exactly that long
#     after its sample. Nav2 applies a command when it comes; a node at the robot that holds each one until its stamp
#     plus the deadline does the same as the model.
#   gains of the surrogate law (goal, heading, repulsion, staleness penalty, safety distance):
{gains}
# c_miss and d_safe act like an inflation_radius that grows with the age of the other robots' positions.
"""
