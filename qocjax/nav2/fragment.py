"""`nav2_params.yaml` of an advice: a fragment, or the user's own file with what is advised, and notes on the rest."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from qocjax.advice.advice import Advice
from qocjax.nav2.advised import Set, advised, setting
from qocjax.nav2.document import Document, source_text
from qocjax.nav2.known import MPPI
from qocjax.nav2.options import stack_values
from qocjax.nav2.read import NavParams, params_of
from qocjax.nav2.write import Change, decimal, merged
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.network.schedule import Rules

__all__ = ["nav2_text"]

_BEGIN, _END = "# ---- notes of qocjax.advise ----", "# ---- end of these notes ----"
_GAINS = {"kappa": "1/s", "gamma": "1/s", "eta": "", "c_miss": "m/s", "d_safe": "m"}


def nav2_text(
    advice: Advice,
    rules: Rules,
    source: str | Path | None = None,
    mppi: MppiConfig | None = None,
    seen: Mapping[str, float] | None = None,
) -> str:
    """The parameters of an advice as a parameter file of ROS 2, with comments on what has no parameter.

    Args:
        advice: What is advised.
        rules: Actuation and hold it was worked out under.
        source: The user's own file, or its text, to come back whole with what is advised; None for a fragment.
        mppi: Of the navigation stack, if the advice was worked out with it; what it has otherwise than Nav2 is set.
        seen: Caps that a recording shows, and that stand for the robot's; they come out with a warning.

    Raises:
        ValueError: The rules ask for plans; or the user's file cannot be read, or ROS's parser would refuse it: one
            line with file and line.
    """
    rules.check_single()
    best = setting(advice, rules, seen)
    tuned = {name: float(np.asarray(value)) for name, value in advice.recommended.others.items()}
    if source is None:
        changes = advised(best, simulated=None if mppi is None else stack_values(mppi), tuned=tuned)
        return f"{_head(advice, best)}\n{merged('', changes).lstrip()}\n{_notes(advice, best, rules, None, changes)}"
    text, name, windows = source_text(source)
    if text.startswith("# From qocjax.advise"):  # its own file from before: the notes are written anew
        text = text.split("\n\n", 1)[-1]
    if _BEGIN in text and _END in text.split(_BEGIN, 1)[1]:
        before, after = text.split(_BEGIN, 1)
        text = before.rstrip("\n") + "\n" + after.split(_END, 1)[1].lstrip("\n")
    params = params_of(Document(text, name))
    changes = advised(best, params, tuned=tuned)
    body = merged(text if "\n" in text else text + "\n", changes, params.namespace).rstrip("\n")
    whole = f"{_head(advice, best)}\n{body}\n\n{_notes(advice, best, rules, params, changes)}"
    return whole.replace("\n", "\r\n") if windows else whole


_WARNINGS = {
    "recommended": "",
    "not shown": "# NOT RECOMMENDED: simulation does not show that collisions keep their limit with it.\n",
    "unsafe": "# NOT RECOMMENDED: collisions break their limit in simulation.\n",
}


def _head(advice: Advice, best: Set) -> str:
    return (
        f"# From qocjax.advise, for the network {advice.network.get('name', '')!r}: deadline "
        f"{1e3 * best.deadline:.4g} ms, by which {advice.character['reliability']:.1%} of the loops complete,\n"
        f"# at a sampling period of {1e3 * best.tau:.4g} ms. Notes on what has no parameter are at the end.\n"
        + _WARNINGS[advice.verdict]
    )


def _notes(advice: Advice, best: Set, rules: Rules, params: NavParams | None, changes: Sequence[Change]) -> str:
    gap = math.ceil((advice.character["p99_miss_run"] + 1) * best.tau * 1e3)
    values = {
        name: float(np.asarray(getattr(advice.recommended, name))) for name in _GAINS if name not in advice.unread
    }
    gains = ", ".join(f"{name} {value:.4g} {_GAINS[name]}".rstrip() for name, value in values.items())
    parts = [
        _WHERE.format(hold=decimal(best.hold)), _delay(best, params, changes), _QOS.format(
            lifespan=round(best.deadline * 1e9), gap=gap, gap_ns=gap * 1_000_000, run=advice.character["p99_miss_run"]),
        _MIDDLEWARE.format(**_duration(best.tau)),
        _REST.format(deadline=1e3 * best.deadline, node=_node(best, rules)),
        _LAW.format(gains=gains) if gains else "",
        *_of_file(best, params, changes),
    ]  # fmt: skip
    return "\n".join([_BEGIN, *(part.strip("\n") for part in parts if part), _END, ""])


def _node(best: Set, rules: Rules) -> str:
    """Parameters of the deadline node of `qocjax.ros`."""
    found = {"deadline": decimal(best.deadline), "period": decimal(best.tau), "hold": rules.hold}
    if rules.actuation == "arrival":
        found["actuation"] = rules.actuation
    if rules.hold in ("timeout", "decay"):
        found[f"hold_{rules.hold}"] = decimal(getattr(rules, f"hold_{rules.hold}"))
    return " ".join(f"-p {name}:={value}" for name, value in found.items())


def _duration(time: float) -> dict[str, int]:
    """A time (s) as Fast DDS's profiles have it."""
    seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
    return {"seconds": seconds, "nanoseconds": nanoseconds}


def _delay(best: Set, params: NavParams | None, changes: Sequence[Change]) -> str:
    """On the delay that MPPI can be told, where it is not set."""
    mppi = params is None or any(each.kind == MPPI for each in params.controllers)
    is_set = any(each.name.endswith("model_delay_vx") for each in changes)
    return _DELAY.format(delay=decimal(best.delay)) if mppi and not is_set else ""


def _of_file(best: Set, params: NavParams | None, changes: Sequence[Change]) -> list[str]:
    """On the user's file: caps that stay, what is unknown, what Nav2 would refuse."""
    if params is None:
        return []
    slower = [f"#   {name} stays at {own:.4g} {unit}, where {cap:.4g} is advised."
              for name, own, cap, unit in (("speed", params.v_max, best.v_max, "m/s"),
                                           ("turn rate", params.omega_max, best.omega_max, "rad/s"))
              if own is not None and own < cap]  # fmt: skip
    set_now = {f" {each.name} is " for each in changes}
    refused = [each for each in params.remarks if not any(name in each for name in set_now)]
    unknown = [f"#   left alone: {each}" for each in params.unknown]
    lines = [*slower, *unknown, *(f"#   {each}" for each in refused)]
    return ["\n".join(["# This file:", *(" ".join(line.splitlines()) for line in lines)])] if lines else []


_WHERE = """
# What runs where. At the edge: controller_server with its costmap, and the planner. On the robot: velocity_smoother,
#   collision_monitor and the base controller. A velocity_timeout in a smoother at the edge protects nobody: when the
#   network fails, its zeros do not reach the robot.
#   Topics, as bringup remaps them: controller_server -> cmd_vel_nav -> velocity_smoother -> cmd_vel_smoothed ->
#   collision_monitor -> cmd_vel -> the base. The one that crosses the network is /cmd_vel_nav.
#   Ages are told by the stamp of a command, with clocks in step and enable_stamped_cmd_vel (false by default in
#   Jazzy); without stamps velocity_timeout counts from the arrival.
#   diff_drive_controller (ros2_control, in a file of its own): cmd_vel_timeout: {hold} s. It drops commands by the
#   age of their stamp and stops the wheels, hold=timeout at the robot. From Lyrical on the smoother stamps anew, so
#   that this tells the smoother's age alone.
#   collision_monitor: source_timeout is the age at which its sensor data stop the robot; at the edge, the uplink
#   counts.
"""

_DELAY = """
# Delay in MPPI's model, from Lyrical on: model_delay_vx and model_delay_wz: {delay} s, until a command acts. Nav2
#   counts it in whole steps of model_dt, and keeps as many of the commands sent, one for each cycle: it fits where
#   model_dt is the period. Jazzy and Kilted have no such parameter.
"""

_QOS = """
# QoS. From Lyrical on parameters may override history, depth, reliability and durability (qos_overrides, unless
#   allow_parameter_qos_overrides is false), nothing else. Leave reliability at reliable: Nav2 reads commands RELIABLE,
#   and such a reader takes nothing from a best_effort writer. What may help is a depth of 1 for /cmd_vel_nav (10 from
#   Lyrical on), at the writer and at the reader:
#     controller_server: ros__parameters: qos_overrides./cmd_vel_nav.publisher.depth: 1
#     velocity_smoother: ros__parameters: qos_overrides./cmd_vel_nav.subscription.depth: 1
#   For code of your own, not for Nav2 (in nanoseconds):
#     lifespan: {lifespan}
#       A command older than the deadline is of no use. It counts for one topic, from the writer on; the deadline
#       covers the whole loop, uplink, compute and downlink, so this is its upper limit. Fast DDS drops at the reader
#       what was written longer ago (clocks in step); Cyclone DDS counts there from reception and hands a late command
#       over; Zenoh has none. Only the deadline node drops every late command.
#     deadline: {gap_ns}
#       Not the loop's deadline, but the longest time between two messages: {gap} ms, as 99 % of the runs of misses
#       are no longer than {run} loops. A reader asks for no less than the writer offers.
"""

_MIDDLEWARE = """
# Middleware (docs/middleware.md of qocjax). Where packets are lost, RELIABLE repairs once a heartbeat tells of the gap.
#   Fast DDS, ROS 2's default, sends one every 3 s, and one with a message while its history is full of unacknowledged
#   ones, which KEEP_ALL's never is. In the profile of its writers (FASTDDS_DEFAULT_PROFILES_FILE), one every tau:
#     <times><heartbeat_period><sec>{seconds}</sec><nanosec>{nanoseconds}</nanosec></heartbeat_period></times>
#   After an outage, with unicast peers as on most 5G networks: Fast DDS and Zenoh are back within 3 s of its end.
#   Cyclone DDS is back up to 30 s later where the outage outlasts its lease of 10 s, and never after 40 s: give it a
#   LeaseDuration beyond any outage.
"""

_REST = """
# Without a counterpart in Nav2:
#   deadline: {deadline:.4g} ms. A loop that takes longer is given up, and a command takes effect exactly that long
#     after its sample. Nav2 applies a command when it comes; the deadline node at the robot does the same as the model
#     (docs/ros.md of qocjax; commands must bear the stamp of their pose, and velocity_smoother reads cmd_vel_held):
#     python -m qocjax.ros.deadline --ros-args {node} -r cmd_vel_in:=cmd_vel_nav -r cmd_vel_out:=cmd_vel_held
"""

_LAW = """
#   gains of the surrogate law (goal, heading, repulsion, staleness penalty, safety distance):
#     {gains}
#     c_miss and d_safe act like an inflation_radius that grows with the age of the other robots' positions.
"""
