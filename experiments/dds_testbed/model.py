"""What the transport model says of a case of the comparison."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import jax
import numpy as np

from experiments.dds_testbed.cases import HORIZON, PROFILES, Case
from experiments.dds_testbed.config import read_config
from qocjax import simulate
from qocjax.network import LoopNetwork
from qocjax.network.dds import TIMERS, DdsNetwork, Profile, Topic, loop_statistics, per_second

__all__ = ["PAYLOAD", "model_of", "modelled", "numbers_of"]

SEEDS = 32
PAYLOAD = {"uplink": 100, "downlink": 28}  # bytes of a serialised State of two robots, and of a Command
_OF_ROS = {"uplink": 172 + 87, "downlink": 68 + 87}  # Path, TwistStamped, and what Fast DDS puts into DATA beside them


def modelled(case: Case) -> bool:
    """Whether the model is of this transport: RTPS, or nothing that repairs; it has no TCP."""
    return case.middleware in TIMERS or case.profile == "best_effort_udp"


def model_of(case: Case) -> DdsNetwork:
    """The network of a case, from the testbed's own configuration."""
    config = read_config(case.options())
    legs = config.build_network()
    if not isinstance(legs, LoopNetwork):
        raise TypeError(f"network: got a {type(legs).__name__}, expected a LoopNetwork")
    depth = PROFILES[case.middleware][case.profile].get("qos.depth", 10)
    depth = None if depth == "null" else depth
    timers = TIMERS.get(case.middleware, {})
    if config.dds.heartbeat_period is not None:
        timers = timers | {"heartbeat_period": config.dds.heartbeat_period}
    profile = Profile(reliability=config.qos.reliability, depth=depth, reader_depth=depth, **timers)
    payload = _OF_ROS if case.middleware == "fastdds" else PAYLOAD
    topics = {
        name: Topic(leg.delay, leg.loss, profile=profile, payload=payload[name], in_order=config.in_order)
        for name, leg in (("uplink", legs.uplink), ("downlink", legs.downlink))
    }
    return DdsNetwork(**topics, compute=legs.compute, name=case.name)


@partial(jax.jit, static_argnames=("network", "ticks", "robots", "tau", "seconds"))
def _simulated(
    network: DdsNetwork, keys: jax.Array, ticks: int, robots: int, tau: float, seconds: int
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Loop times [S, P, N] and bytes in each second [S, N, seconds] of either direction."""

    def one(key: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        loops = network.loops(key, ticks, robots, tau)
        up = jax.vmap(lambda each: per_second(network.uplink, each, seconds))(loops.uplink_traffic)
        down = jax.vmap(lambda each: per_second(network.downlink, each, seconds))(loops.downlink_traffic)
        return (
            loops.loop_time,
            up["forward_bytes"] + down["backward_bytes"],
            down["forward_bytes"] + up["backward_bytes"],
        )

    return jax.vmap(one)(keys)


def numbers_of(case: Case) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Numbers of each seed, [S] each with the AUC [S, N], and all its loop times [S, P, N] (s).

    As in the testbed there are loops before the run and after it, and what comes later than these is lost.
    """
    config = read_config(case.options())
    scenario, tau, robots = config.build_scenario(), config.loop.tau, len(config.scenario.start)
    before, run, after = (round(time / tau) for time in (config.warm_up, HORIZON, config.cool_down))
    keys, ticks = jax.random.split(jax.random.key(1), SEEDS), before + run + after
    seconds = int(config.warm_up + HORIZON + config.cool_down)
    whole, *sent = (np.asarray(each) for each in _simulated(model_of(case), keys, ticks, robots, tau, seconds))
    times, window = whole[:, before : before + run], slice(int(config.warm_up), int(config.warm_up + HORIZON))
    left = tau * (run + after - np.arange(run))[:, None]
    times = np.where(times <= left, times, np.inf)
    each_seed = [loop_statistics(seed.T, tau) for seed in times]
    numbers = {name: np.array([seed[name] for seed in each_seed]) for name in each_seed[0]}
    if case.middleware == "cyclonedds":  # Fast DDS's nodes have other topics beside these
        for leg, each in zip(("uplink", "downlink"), sent, strict=True):
            numbers[f"{leg}_bytes"] = each[:, :, window].mean(axis=2).sum(axis=1)
    plan = config.build_plan(False, Path())
    auc = jax.vmap(lambda each: simulate(scenario, plan.as_design(), each, **plan.rules).auc)
    numbers["auc"] = np.asarray(auc(times))
    return numbers, times
