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
from qocjax.network.dds import DdsNetwork, Profile, Topic, loop_statistics, per_second

__all__ = ["PAYLOAD", "model_of", "numbers_of"]

SEEDS = 32
PAYLOAD = {"uplink": 100, "downlink": 28}  # bytes of a serialised State of two robots, and of a Command


def model_of(case: Case) -> DdsNetwork:
    """The network of a case, from the testbed's own configuration."""
    config = read_config(case.options())
    legs = config.build_network()
    if not isinstance(legs, LoopNetwork):
        raise TypeError(f"network: got a {type(legs).__name__}, expected a LoopNetwork")
    reliability, depth = PROFILES[case.profile]
    profile = Profile(reliability=reliability, depth=depth, reader_depth=depth)
    topics = {
        name: Topic(leg.delay, leg.loss, profile=profile, payload=PAYLOAD[name], in_order=config.in_order)
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

    As in the testbed there are loops before the run and after it.
    """
    config = read_config(case.options())
    scenario, tau, robots = config.build_scenario(), config.loop.tau, len(config.scenario.start)
    before, run, after = (round(time / tau) for time in (config.warm_up, HORIZON, config.cool_down))
    keys, ticks = jax.random.split(jax.random.key(1), SEEDS), before + run + after
    seconds = int(config.warm_up + HORIZON + config.cool_down)
    whole, *sent = (np.asarray(each) for each in _simulated(model_of(case), keys, ticks, robots, tau, seconds))
    times, window = whole[:, before : before + run], slice(int(config.warm_up), int(config.warm_up + HORIZON))
    each_seed = [loop_statistics(seed.T, tau) for seed in times]
    numbers = {name: np.array([seed[name] for seed in each_seed]) for name in each_seed[0]}
    for leg, each in zip(("uplink", "downlink"), sent, strict=True):
        numbers[f"{leg}_bytes"] = each[:, :, window].mean(axis=2).sum(axis=1)
    plan = config.build_plan(False, Path())
    auc = jax.vmap(lambda each: simulate(scenario, plan.as_design(), each, **plan.rules).auc)
    numbers["auc"] = np.asarray(auc(times))
    return numbers, times
