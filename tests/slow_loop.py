"""The closed loop in plain Python: one event after the other, written from the equations of the model.

Slow and independent on purpose. The kernels of the package are judged against it, so it shares no code with them.
Sections cited are those of the model.
"""

from __future__ import annotations

import math
from collections import defaultdict
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, pairwise
from typing import Any

import numpy as np

ROUNDING = 1e-6  # comparisons of times allow for this, relative
FLOOR = 1e-6  # m, smallest distance that the control law sees
GAUSS = list(zip(*(column.tolist() for column in np.polynomial.legendre.leggauss(5)), strict=True))
OPTIONS = {
    "actuation": ("deadline", "arrival", "instant"),
    "hold": ("hold", "zero", "timeout", "decay", "buffer"),
    "reference": ("nominal", "uncapped", "follow"),
    "normaliser": ("start", "goal_distance"),
}


def nearest_multiple(length: float, tau: float) -> int | None:
    """The integer n with length = n tau up to rounding, None where there is none."""
    ratio = length / tau
    n = round(ratio)
    return n if abs(ratio - n) <= ROUNDING * max(1.0, ratio) else None


def sampling_instants(horizon: float, tau: float) -> list[float]:
    """t_0 .. t_P in s; the last interval is cut at the horizon where tau does not divide it."""
    whole = nearest_multiple(horizon, tau)
    ticks = whole if whole is not None else math.ceil(horizon / tau)
    return [p * tau for p in range(ticks)] + [horizon]


@dataclass(frozen=True)
class Reference:
    """The nominal path from `start` to `goal`: straight at the cap, then exponential (section 5)."""

    start: tuple[float, float]
    goal: tuple[float, float]
    kappa: float
    v_max: float

    @cached_property
    def length(self) -> float:
        """Distance from start to goal."""
        return math.dist(self.start, self.goal)

    @cached_property
    def corner(self) -> float:
        """Time from which kappa |p - p*| is below the cap."""
        if self.kappa * self.length <= self.v_max:
            return 0.0
        return (self.length - self.v_max / self.kappa) / self.v_max if self.v_max > 0 else math.inf

    def at(self, t: float) -> tuple[float, float]:
        """Position at time t."""
        if self.length == 0:
            return self.goal
        left = self.length - self.v_max * min(t, self.corner) if self.corner > 0 else self.length
        share = left * math.exp(-self.kappa * max(0.0, t - self.corner)) / self.length
        (x0, y0), (xg, yg) = self.start, self.goal
        return xg + share * (x0 - xg), yg + share * (y0 - yg)


@dataclass
class Robot:
    """A unicycle, the command in force on it, and what it has summed up so far."""

    x: float
    y: float
    theta: float
    goal: tuple[float, float]
    path: Reference
    weights: tuple[float, float]
    nu: float = 0.0
    omega: float = 0.0
    sampled: float | None = None  # s, sampling instant of the command in force; None before the first
    scale: float = 1.0  # what the hold rule leaves of the command
    area: float = 0.0  # integral of |p - reference|²_W
    length: float = 0.0  # integral of |nu|
    effort: float = 0.0  # integral of nu² + omega²
    rest: list[tuple[float, ...]] = field(default_factory=list)  # commands of the packet that are still to come

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, heading)."""
        return self.x, self.y, self.theta

    @property
    def command(self) -> tuple[float, ...]:
        """The command after the hold rule (m/s, rad/s)."""
        return self.scale * self.nu, self.scale * self.omega

    def age(self, t: float) -> float:
        """Age of the command in force, counted from t_0 = 0 before the first (section 3)."""
        return t - (0.0 if self.sampled is None else self.sampled)

    def squared_distance(self, x: float, y: float, other: tuple[float, float]) -> float:
        """|(x, y) - other|²_W."""
        return self.weights[0] * (x - other[0]) ** 2 + self.weights[1] * (y - other[1]) ** 2

    def steer(self, vx: float, vy: float, design: dict[str, float]) -> tuple[float, ...]:
        """The command that follows a wanted velocity (section 3)."""
        # Adding 0.0 turns -0.0 into 0.0: a robot exactly at its goal then has direction 0, not pi.
        error = math.remainder(math.atan2(vy + 0.0, vx + 0.0) - self.theta, 2 * math.pi)
        nu = math.hypot(vx, vy) * max(math.cos(error), 0.0)
        omega = design["gamma"] * error
        return min(nu, design["v_max"]), max(-design["omega_max"], min(omega, design["omega_max"]))

    def pose_after(self, h: float) -> tuple[float, float, float]:
        """Pose after h seconds of the command in force: an exact arc (section 2)."""
        nu, omega = self.command
        a = omega * h / 2
        chord = nu * h * (math.sin(a) / a if a else 1.0)
        return self.x + chord * math.cos(self.theta + a), self.y + chord * math.sin(self.theta + a), self.theta + 2 * a

    def set(self, command: tuple[float, ...]) -> None:
        """Takes a new command."""
        self.nu, self.omega = command

    def spent(self) -> tuple[float, float]:
        """Path length and effort per second of the command in force."""
        nu, omega = self.command
        return abs(nu), nu**2 + omega**2

    def move(self, t0: float, t1: float, substeps: int) -> None:
        """Drive from t0 to t1 under one command, and sum up: 5-point Gauss on each of the substeps."""
        length, effort = self.spent()
        self.length += length * (t1 - t0)
        self.effort += effort * (t1 - t0)
        cuts = [t0, self.path.corner, t1] if t0 < self.path.corner < t1 else [t0, t1]
        for left, right in pairwise(cuts):
            half = (right - left) / (2 * substeps)
            for part in range(substeps):
                for node, weight in GAUSS:
                    t = left + half * (2 * part + 1 + node)
                    x, y, _ = self.pose_after(t - t0)
                    self.area += half * weight * self.squared_distance(x, y, self.path.at(t))
        self.x, self.y, self.theta = self.pose_after(t1 - t0)

    def end_loop(self, sampled: float, packet: list[tuple[float, ...]] | None, hold: str) -> None:
        """A loop ends: its command takes effect, or (None) it counts as missed; an outdated end is ignored."""
        if self.sampled is not None and sampled < self.sampled:
            return
        if packet is not None:
            self.set(packet[0])
            self.rest, self.sampled, self.scale = packet[1:], sampled, 1.0
        elif hold == "zero":
            self.scale = 0.0
        elif hold == "buffer":
            command, *self.rest = *self.rest, tuple(0.0 for _ in self.command)
            self.set(command)

    def apply_hold(self, t: float, deadline: float, hold: str, timeout: float, decay: float) -> None:
        """What the hold rule makes of the command in force, at the sampling instant t (section 4)."""
        if hold == "timeout":
            self.scale = 0.0 if self.age(t) > timeout * (1 + ROUNDING) else 1.0
        elif hold == "decay":
            self.scale = math.exp(-max(0.0, self.age(t) - deadline) / decay)


def towards(speed: float, wanted: float, up: float, down: float, h: float) -> float:
    """A speed after h seconds on its way: it falls at the rate `down` and grows at the rate `up`, through 0 or not."""
    low = math.copysign(min(abs(speed), abs(wanted)), speed) if speed * wanted > 0 else 0.0
    fall = abs(speed - low) / down
    if h <= fall:
        return speed + math.copysign(down * h, low - speed)
    return wanted if h - fall >= abs(wanted - low) / up else low + math.copysign(up * (h - fall), wanted - low)


@dataclass
class SluggishRobot(Robot):
    """A unicycle whose speeds follow the command at limited rates: many small steps instead of any formula."""

    limits: tuple[float, float, float] = (math.inf, -math.inf, math.inf)  # ax_max, ax_min, az_max
    driven: tuple[float, float] = (0.0, 0.0)

    def after(self, speed: tuple[float, float], h: float) -> tuple[float, float]:
        """Speeds after h seconds of the command in force."""
        up, down, turn = self.limits
        return (towards(speed[0], self.command[0], up, -down, h), towards(speed[1], self.command[1], turn, turn, h))

    def move(self, t0: float, t1: float, substeps: int) -> None:
        """Drive from t0 to t1: the midpoint rule on 100 steps, Simpson's rule for the totals."""
        h = (t1 - t0) / 100
        for step in range(100):
            begin, middle, end = self.driven, self.after(self.driven, h / 2), self.after(self.driven, h)
            t = t0 + step * h
            square = [self.squared_distance(self.x, self.y, self.path.at(t))]
            x, y = self.x, self.y
            for part in (0.5, 1.0):
                theta = self.theta + part * h * (begin[1] + self.after(begin, part * h / 2)[1]) / 4
                nu = self.after(begin, part * h / 2)[0]
                self.x, self.y = x + part * h * nu * math.cos(theta), y + part * h * nu * math.sin(theta)
                square.append(self.squared_distance(self.x, self.y, self.path.at(t + part * h)))
            self.theta += h * (begin[1] + 4 * middle[1] + end[1]) / 6
            self.area += h * (square[0] + 4 * square[1] + square[2]) / 6
            self.length += h * (abs(begin[0]) + 4 * abs(middle[0]) + abs(end[0])) / 6
            self.effort += h * sum(a * a + 4 * b * b + c * c for a, b, c in zip(begin, middle, end, strict=True)) / 6
            self.driven = end


@dataclass
class HolonomicRobot(Robot):
    """A point that moves as it is told, in the axes of its body; `nu` and `left` ahead and to the left."""

    left: float = 0.0

    @property
    def command(self) -> tuple[float, ...]:
        """The command after the hold rule (m/s, rad/s, m/s)."""
        return self.scale * self.nu, 0.0, self.scale * self.left

    def steer(self, vx: float, vy: float, design: dict[str, float]) -> tuple[float, ...]:
        """The wanted velocity, no faster than the cap."""
        share = min(1.0, design["v_max"] / max(math.hypot(vx, vy), 1e-300))
        c, s = math.cos(self.theta), math.sin(self.theta)
        return share * (vx * c + vy * s), 0.0, share * (vy * c - vx * s)

    def set(self, command: tuple[float, ...]) -> None:
        """Takes a new command."""
        self.nu, _, self.left = command

    def pose_after(self, h: float) -> tuple[float, float, float]:
        """A straight line."""
        ahead, _, left = self.command
        c, s = math.cos(self.theta), math.sin(self.theta)
        return self.x + h * (ahead * c - left * s), self.y + h * (ahead * s + left * c), self.theta

    def spent(self) -> tuple[float, float]:
        """Path length and effort per second."""
        square = self.command[0] ** 2 + self.command[2] ** 2
        return math.sqrt(square), square


@dataclass
class AckermannRobot(Robot):
    """A bicycle about its rear axle: its steering wheel goes where the command asks, or as far as it can."""

    wheelbase: float = 1.0
    max_steering: float = 0.5

    def steer(self, vx: float, vy: float, design: dict[str, float]) -> tuple[float, ...]:
        """Towards the velocity with the front or with the rear, whichever takes the smaller turn."""
        towards = math.atan2(vy + 0.0, vx + 0.0) - self.theta
        front, rear = math.remainder(towards, 2 * math.pi), math.remainder(towards + math.pi, 2 * math.pi)
        nu = math.hypot(vx, vy) * math.cos(front)
        nu = max(-design["v_max"], min(nu, design["v_max"]))
        omega = design["gamma"] * (front if abs(front) <= math.pi / 2 else rear)
        omega = max(-design["omega_max"], min(omega, design["omega_max"]))
        most = abs(nu) * math.tan(self.max_steering) / self.wheelbase
        return nu, max(-most, min(omega, most))

    def turn_rate(self) -> float:
        """Of the body, at the steering angle in force."""
        nu, omega = self.command
        if nu == 0:
            return 0.0
        angle = math.atan(self.wheelbase * omega / nu)
        return nu * math.tan(max(-self.max_steering, min(angle, self.max_steering))) / self.wheelbase

    def pose_after(self, h: float) -> tuple[float, float, float]:
        """Forty steps of Runge and Kutta's rule; the heading is linear in time, so it is Simpson's."""
        nu, omega = self.command[0], self.turn_rate()
        x, y, k = self.x, self.y, h / 40
        for step in range(40):
            at = [self.theta + omega * k * (step + part) for part in (0, 0.5, 1)]
            x += k * nu * (math.cos(at[0]) + 4 * math.cos(at[1]) + math.cos(at[2])) / 6
            y += k * nu * (math.sin(at[0]) + 4 * math.sin(at[1]) + math.sin(at[2])) / 6
        return x, y, self.theta + omega * h

    def spent(self) -> tuple[float, float]:
        """Path length and effort per second."""
        return abs(self.command[0]), self.command[0] ** 2 + self.turn_rate() ** 2


def control(i: int, robots: list[Robot], ages: list[float], design: dict[str, float]) -> tuple[float, ...]:
    """Command of robot i from the poses and ages at one sampling instant (section 3)."""
    me = robots[i]
    vx, vy = -design["kappa"] * (me.x - me.goal[0]), -design["kappa"] * (me.y - me.goal[1])
    for j, other in enumerate(robots):
        d = max(math.hypot(me.x - other.x, me.y - other.y), FLOOR)
        d_eff = design["d_safe"] + design["c_miss"] * max(0.0, max(ages[i], ages[j]) - design["deadline"])
        if j != i and d < d_eff:
            push = design["eta"] * (1 / d - 1 / d_eff) / d**3
            vx, vy = vx + push * (me.x - other.x), vy + push * (me.y - other.y)
    return me.steer(vx, vy, design)


def plans(
    robots: list[Robot], sent: list[list[tuple[float, ...]]], ages: list[float], design: dict[str, float],
    actuation: str, length: int,
) -> list[list[tuple[float, ...]]]:  # fmt: skip
    """The packets of all robots: the law, driven on from where what was sent will have led them."""
    ghosts = [copy(robot) for robot in robots]

    def drive(commands: list[tuple[float, ...]], h: float) -> None:
        for ghost, command in zip(ghosts, commands, strict=True):
            ghost.set(command)
            ghost.scale = 1.0
            ghost.move(0.0, h, 1)

    tau, still = design["tau"], [tuple(0.0 for _ in ghost.command) for ghost in ghosts]
    whole, rest = effect_delay(0.0, False, design, actuation)
    for ticks_ago in range(whole + 1, 0, -1):  # the oldest is in force for what is left of its period
        commands = sent[-ticks_ago] if ticks_ago <= len(sent) else still
        drive(commands, rest if ticks_ago == whole + 1 else tau)
    packets: list[list[tuple[float, ...]]] = [[] for _ in robots]
    for k in range(length):
        commands = [control(i, ghosts, [a + k * tau for a in ages], design) for i in range(len(robots))]
        for packet, command in zip(packets, commands, strict=True):
            packet.append(command)
        drive(commands, tau)
    return packets


def effect_delay(loop_time: float, completed: bool, design: dict[str, float], actuation: str) -> tuple[int, float]:
    """When a loop ends: (m, f) stands for f seconds after the m-th sampling instant from its own (section 4)."""
    tau, deadline = design["tau"], design["deadline"]
    if actuation == "instant":
        return 0, 0.0
    if actuation == "arrival" and completed:
        return math.ceil(loop_time / tau - ROUNDING), 0.0
    whole = nearest_multiple(deadline, tau)
    if whole is not None:
        return whole, 0.0
    m = math.floor(deadline / tau)
    return (m + 1, 0.0) if actuation == "arrival" else (m, deadline - m * tau)


KINDS = {
    "unicycle": Robot, "sluggish": SluggishRobot, "holonomic": HolonomicRobot, "ackermann": AckermannRobot,
}  # fmt: skip


def make_robots(
    start: Any, goal: Any, kappa: float, v_max: float, per_robot: bool, weights: Any, kind: str, numbers: Any
) -> list[Robot]:
    """The robots at rest at their start, each with its goal and its reference path."""
    starts = np.asarray(start, float)
    goals = [(float(x), float(y)) for x, y in np.broadcast_to(np.asarray(goal, float), (len(starts), 2))]
    if not per_robot and len(set(goals)) > 1:
        raise ValueError(f"goal: got {goals}, expected one goal for all robots, or reference_per_robot")
    centroid = (math.fsum(starts[:, 0]) / len(starts), math.fsum(starts[:, 1]) / len(starts))
    robots = []
    for (x, y, theta), target in zip(starts.tolist(), goals, strict=True):
        path = Reference((x, y) if per_robot else centroid, target, kappa, v_max)
        robots.append(KINDS[kind](x, y, theta, target, path, weights, **numbers))
    return robots


def arrival_time(robot: Robot, i: int, time: list[float], pose: list[Any], radius: float) -> float:
    """First sampling instant from which robot i stays within the radius of its goal; inf if none."""
    arrived = math.inf
    for t, at_t in zip(reversed(time), reversed(pose), strict=True):
        if math.dist(at_t[i][:2], robot.goal) > radius:
            break
        arrived = t
    return arrived


def simulate(
    robots: list[Robot], time: list[float], loops: np.ndarray, design: dict[str, float],
    actuation: str, hold: tuple[str, float, float], substeps: int, plan_length: int | None = None,
) -> tuple[list[Any], list[Any], list[Any], list[bool]]:  # fmt: skip
    """Drive the robots from t_0 to t_P: poses [P+1], commands and ages [P] by tick, and which loops completed.

    `hold` is (rule, timeout, decay).
    """
    pose, command, age, completed = [[r.pose for r in robots]], [], [], []
    sent: list[list[tuple[float, ...]]] = []  # first commands of all robots, by tick
    # Ends of loops, by tick: those at the sampling instant, and those some time after it.
    at_tick: dict[int, list[Any]] = defaultdict(list)
    after_tick: dict[int, list[Any]] = defaultdict(list)
    for p, (t, t_next) in enumerate(pairwise(time)):
        for robot, sampled, u in at_tick.pop(p, []):
            robot.end_loop(sampled, u, hold[0])

        age.append([r.age(t) for r in robots])
        if plan_length is None:
            decided = [[control(i, robots, age[p], design)] for i in range(len(robots))]
        else:
            decided = plans(robots, sent, age[p], design, actuation, plan_length)
        sent.append([packet[0] for packet in decided])
        for i, robot in enumerate(robots):
            loop_time = float(loops[p, i])
            completed.append(loop_time <= design["deadline"] * (1 + ROUNDING))
            ticks, seconds = effect_delay(loop_time, completed[-1], design, actuation)
            end = (robot, t, decided[i] if completed[-1] else None)
            if seconds > 0:
                after_tick[p + ticks].append((seconds, *end))
            else:
                at_tick[p + ticks].append(end)
        for robot, sampled, u in at_tick.pop(p, []):  # those without delay, right after the controller
            robot.end_loop(sampled, u, hold[0])

        for r in robots:
            r.apply_hold(t, design["deadline"], *hold)
        command.append([r.command for r in robots])

        now = t
        for seconds, robot, sampled, u in after_tick.pop(p, []):
            if t + seconds >= t_next:  # only where the last interval is cut short
                break
            for r in robots:
                r.move(now, t + seconds, substeps)
            now = t + seconds
            robot.end_loop(sampled, u, hold[0])
        for r in robots:
            r.move(now, t_next, substeps)
        pose.append([r.pose for r in robots])
    return pose, command, age, completed


def run(
    start: Any, goal: Any, horizon: float, design: dict[str, float], loop_times: Any, *,
    actuation: str = "deadline", hold: str = "hold", hold_timeout: float = 0.5, hold_decay: float = 0.5,
    reference: str = "nominal", reference_kappa: float = 2.0, reference_v_max: float = 0.7,
    reference_per_robot: bool = False, weights: tuple[float, float] = (1.0, 1.0), normaliser: str = "start",
    plan_length: int | None = None, substeps: int = 1, robot: str = "unicycle", numbers: dict[str, Any] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Simulate one run and score it.

    `start` is [N, 3], `goal` (2,) or [N, 2], `loop_times` [P, N] in s with inf where lost; `design` has v_max,
    omega_max, eta, kappa, gamma, c_miss, d_safe, tau, deadline. `hold_timeout` and `hold_decay` are in s; `plan_length`
    counts the commands of a packet, with hold `buffer`.
    `reference_kappa` and `reference_v_max` are the nominal ones; `reference_per_robot` gives each robot its own path,
    from its start to its goal. `substeps` counts the parts, of 5 Gauss points each, of every piece between two events.
    `robot` is one of KINDS, `numbers` are what its class has beside a unicycle's.

    Returns:
        time [P+1], pose [P+1, N, 3], command [P, N, 2], age [P, N]; per robot auc, path_length, effort, arrival_time
        [N]; and the numbers min_distance (inf for one robot), completed, mean_age, peak_age.

    Raises:
        ValueError: for an unknown option, a wrong shape of loop_times, or a robot whose normaliser is zero.
    """
    chosen = {"actuation": actuation, "hold": hold, "reference": reference, "normaliser": normaliser}
    for name, value in chosen.items():
        if value not in OPTIONS[name]:
            raise ValueError(f"{name}: got {value!r}, expected one of {OPTIONS[name]}")
    kappa, v_max = (design["kappa"], design["v_max"]) if reference == "follow" else (reference_kappa, reference_v_max)
    v_max = math.inf if reference == "uncapped" else v_max
    robots = make_robots(start, goal, kappa, v_max, reference_per_robot, weights, robot, numbers or {})
    scales = [r.squared_distance(r.x, r.y, r.path.start if normaliser == "start" else r.goal) for r in robots]
    if min(scales) <= 1e-18:  # within a nanometre
        raise ValueError(f"normaliser: {normaliser!r} gives {scales}, expected > 0; try 'goal_distance'")
    time = sampling_instants(horizon, design["tau"])
    loops = np.asarray(loop_times, float)
    if loops.shape != (len(time) - 1, len(robots)) or np.isnan(loops).any():
        raise ValueError(f"loop_times: got shape {loops.shape}, expected {(len(time) - 1, len(robots))} without NaN")

    rule = (hold, hold_timeout, hold_decay)
    pose, command, age, completed = simulate(robots, time, loops, design, actuation, rule, substeps, plan_length)

    pairs = combinations(range(len(robots)), 2)
    apart = [math.dist(at_t[i][:2], at_t[j][:2]) for i, j in pairs for at_t in pose]
    reach = 2 * design["d_safe"]
    return {
        "time": np.array(time),
        "pose": np.array(pose),
        "command": np.array(command),
        "age": np.array(age),
        "auc": np.array([r.area / scale for r, scale in zip(robots, scales, strict=True)]),
        "min_distance": min(apart, default=math.inf),
        "path_length": np.array([r.length for r in robots]),
        "effort": np.array([r.effort for r in robots]),
        "arrival_time": np.array([arrival_time(r, i, time, pose, reach) for i, r in enumerate(robots)]),
        "completed": float(np.mean(completed)),
        "mean_age": float(np.mean(age)),
        "peak_age": float(np.max(age)),
    }
