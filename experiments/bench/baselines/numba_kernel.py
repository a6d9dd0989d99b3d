"""What Numba compiles for `numba_loop`. Importing it needs Numba."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange  # type: ignore[import-untyped]

from experiments.bench.baselines.work import MIN_DISTANCE

__all__ = ["run_lanes"]

# All of fastmath but `nnan` and `ninf`, under which comparing an infinite (lost) loop time is undefined.
FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}
# Numba computes float32 with a Python float in float64, so constants are float32.
ZERO, HALF, ONE, SIXTH = np.float32(0), np.float32(0.5), np.float32(1), np.float32(1 / 6)
FLOOR, SMALL = np.float32(MIN_DISTANCE), np.float32(1e-3)


@njit(fastmath=FAST)
def _arc(x, y, theta, nu, omega, h):
    """Exact arc (model, section 2)."""
    a = HALF * omega * h
    sinc = math.sin(a) / a if abs(a) > SMALL else ONE - a * a * SIXTH
    chord = nu * h * sinc
    return x + chord * math.cos(theta + a), y + chord * math.sin(theta + a), theta + a + a


@njit(fastmath=FAST)
def _push(i, pose, stale_from, now, design, deadline):
    """Repulsion of robot i from the others (model, Eqs. 5 and 6)."""
    push_x, push_y = ZERO, ZERO
    for j in range(pose.shape[0]):
        if j != i:
            dx, dy = pose[i, 0] - pose[j, 0], pose[i, 1] - pose[j, 1]
            distance = max(math.sqrt(dx * dx + dy * dy), FLOOR)
            stale = max(now - min(stale_from[i], stale_from[j]) - deadline, ZERO)
            effective = design[6] + design[3] * stale
            if distance < effective:
                inverse = ONE / distance
                factor = design[1] * (inverse - ONE / effective) * inverse * inverse * inverse
                push_x += factor * dx
                push_y += factor * dy
    return push_x, push_y


@njit(fastmath=FAST)
def _control(x, y, theta, goal, push_x, push_y, design):
    """Saturated command; the desired velocity is taken along and across the heading, so nothing wraps."""
    v_x, v_y = push_x - design[0] * (x - goal[0]), push_y - design[0] * (y - goal[1])
    c, s = math.cos(theta), math.sin(theta)
    along, across = c * v_x + s * v_y, c * v_y - s * v_x
    omega = design[2] * math.atan2(across, along)
    return min(max(along, ZERO), design[4]), min(max(omega, -design[5]), design[5])


@njit(fastmath=FAST)
def _squared(x, y, reference, weights):
    ex, ey = x - reference[0], y - reference[1]
    return weights[0] * ex * ex + weights[1] * ey * ey


@njit(fastmath=FAST)
def _run(design, deadline, lag, rest, loop_times, start, path, goal, weights, tau, auc):
    """One run; writes the AUC of its robots, [N]."""
    num_ticks, num_robots = loop_times.shape
    depth = lag + 1
    sent = np.zeros((depth, num_robots, 2), np.float32)  # ring of commands
    command = np.zeros((num_robots, 2), np.float32)
    born = np.zeros(num_robots, np.float32)  # s, sampling instant of the command in force
    pose = start.copy()
    total = np.zeros(num_robots, np.float32)
    for p in range(num_ticks):
        now = np.float32(p) * tau
        for i in range(num_robots):
            push_x, push_y = _push(i, pose, born, now, design, deadline)
            nu, omega = _control(pose[i, 0], pose[i, 1], pose[i, 2], goal, push_x, push_y, design)
            sent[p % depth, i, 0], sent[p % depth, i, 1] = nu, omega
        loop = p - lag
        for i in range(num_robots):
            total[i] += _squared(pose[i, 0], pose[i, 1], path[p], weights)
            x, y, theta = pose[i, 0], pose[i, 1], pose[i, 2]
            if rest > ZERO:
                x, y, theta = _arc(x, y, theta, command[i, 0], command[i, 1], rest)
            if loop >= 0 and loop_times[loop, i] <= deadline:
                command[i, 0], command[i, 1] = sent[loop % depth, i, 0], sent[loop % depth, i, 1]
                born[i] = np.float32(loop) * tau
            if rest < tau:
                x, y, theta = _arc(x, y, theta, command[i, 0], command[i, 1], tau - rest)
            pose[i, 0], pose[i, 1], pose[i, 2] = x, y, theta
    for i in range(num_robots):
        first = _squared(start[i, 0], start[i, 1], path[0], weights)
        last = _squared(pose[i, 0], pose[i, 1], path[num_ticks], weights)
        auc[i] = tau * (total[i] + HALF * (last - first)) / first


@njit(parallel=True, fastmath=FAST)
def run_lanes(design, deadline, lag, rest, seed, loop_times, start, path, goal, weights, tau):
    """AUC [L, N] of all lanes; the columns of `design` are those of `work.DESIGN`."""
    auc = np.empty((seed.shape[0], start.shape[1]), np.float32)
    for k in prange(seed.shape[0]):
        s = seed[k]
        _run(design[k], deadline[k], lag[k], rest[k], loop_times[s], start[s], path[s], goal, weights, tau, auc[k])
    return auc
