"""One run from a configuration to tables and a record."""

from __future__ import annotations

import importlib.util
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd

from experiments.dds_testbed import bag, scores
from experiments.dds_testbed.config import TestbedConfig, read_config
from experiments.dds_testbed.crossing import ReceivedBy, past_the_radio
from experiments.dds_testbed.hub import Hub, Traffic
from experiments.dds_testbed.link import ROBOT, tap_usable
from experiments.dds_testbed.middlewares import require
from experiments.dds_testbed.plan import Plan
from experiments.dds_testbed.radio import compute_times, draw_radio
from qocjax.network.dds import loop_statistics
from qocjax.quality import QocScale, qoc
from qocjax.store import write_json, written
from qocjax.store.provenance import provenance

__all__ = ["measure", "run_and_write"]

_FRAMES_PER_LOOP = {"fastdds": 12}  # of each direction; so many get draws of their own, of others 4


def run_and_write(options: list[str]) -> bool:
    """Runs what the options say, writes loops, poses and the record, and prints a summary; whether the run counts."""
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that everything is put away then, too
    config = read_config(options)
    require(config.middleware)
    if config.bag and importlib.util.find_spec("rosbags") is None:
        raise OSError("bag=true needs rosbags, found none: pip install 'qocjax[ros]'")
    record = measure(config, Path(config.folder), lambda text: print(text, flush=True))
    print(_summary(record))
    for reason in record["rejected"]:
        print(f"rejected: {reason}")
    print(f"Loops, poses and the record are in {config.folder}")
    return not record["rejected"]


def measure(config: TestbedConfig, output: Path, say: Callable[[str], None] = lambda text: None) -> dict[str, Any]:
    """Makes one run and writes `loops_<robot>.csv`, `poses.csv` and `record.json`; returns the record.

    Raises:
        ValueError: A value of the configuration is out of range.
        OSError: The system does not let the testbed run, or a process fails.
    """
    tap = config.link == "tap" or (config.link == "auto" and tap_usable())
    if config.middleware == "fastdds" and not tap:
        raise OSError("middleware=fastdds needs TAP devices (link=tap, /dev/net/tun): over virtual Ethernet its nodes "
                      "do not find each other")  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="dds_testbed-") as folder:
        plan, network = config.build_plan(tap, Path(folder)), config.build_network()
        of_radio, of_compute = jax.random.split(jax.random.key(config.key))
        ticks, tau = plan.num_ticks + sum(plan.padding) + 50, plan.design["tau"]
        radio = draw_radio(
            network, of_radio, ticks * _FRAMES_PER_LOOP.get(plan.middleware, 4), ticks, plan.num_robots, tau
        )
        np.save(Path(folder) / "compute.npy", compute_times(network, of_compute, ticks, plan.num_robots))
        config.write(Path(folder))
        scale = scores.ideal_scale(config.build_scenario(), plan, config.build_controller())  # also checks the scenario
        say(f"{'TAP' if tap else 'virtual Ethernet'} links, one for each of {plan.num_robots} robots")
        with Hub(plan) as hub:
            traffic = hub.run(radio, config.in_order, say)
        loops, received = scores.loop_table(plan, traffic.start), scores.received(plan)
        record = _record(config, plan, traffic, loops, received, scale)
        record |= {"network": network.describe(), **provenance()}
        for robot, table in loops.groupby("robot"):
            _write_csv(output / f"loops_{robot}.csv", table)
        _write_csv(output / "poses.csv", scores.pose_table(plan))
        write_json(output / "record.json", record)
        if config.bag:
            bag.record(output / "bag", plan, received[ROBOT], traffic.start)
    return record


def _record(
    config: TestbedConfig,
    plan: Plan,
    traffic: Traffic,
    loops: pd.DataFrame,
    received: list[ReceivedBy],
    scale: QocScale,
) -> dict[str, Any]:
    """Everything that one run says, in plain values; s and bytes per s."""
    scenario, tau = config.build_scenario(), plan.design["tau"]
    times = scores.loop_times(plan, loops)
    auc, again = (
        scores.auc_of(scenario, plan, np.load(Path(plan.folder) / "robot.npz")),
        scores.replayed(scenario, plan, times, config.build_controller()),
    )
    ticks = np.arange(plan.num_ticks) * tau
    behind = loops["uplink_send"].to_numpy() - np.tile(ticks, plan.num_robots)
    lateness = {"relay": np.asarray(traffic.lateness) * 1e-9, "tick": behind}
    late = {
        name: {f"p{level}": float(np.percentile(of, level)) for level in (50, 99, 100)} for name, of in lateness.items()
    }
    limits = {"relay": config.limits.relay_p99_ms, "tick": config.limits.tick_p99_ms}
    return {
        "qos": config.qos.model_dump(), "tau": tau, "deadline": plan.design["deadline"], **plan.rules,
        "middleware": plan.middleware, "options": plan.options,
        "horizon": plan.horizon, "num_robots": plan.num_robots, "in_order": config.in_order, "key": config.key,
        "loops": loop_statistics(times.T, tau), "messages": scores.messages(plan, received),
        "auc": auc.tolist(), "auc_replayed": again.tolist(),
        "qoc": float(np.mean(qoc(auc, scale))), "j_med": scale.median, "j_max": scale.largest,
        "link": {
            name: {what: count / plan.horizon for what, count in sorted(sent.items())}
            for name, sent in zip(("uplink", "downlink"), traffic.sent, strict=True)
        },
        "lateness": late,
        "rejected": past_the_radio(traffic.crossed, received) + [
            f"{name} lateness of {late[name]['p99'] * 1e3:.2f} ms (99th percentile) is beyond {limit:g} ms"
            for name, limit in limits.items() if late[name]["p99"] * 1e3 > limit
        ],
    }  # fmt: skip


def _summary(record: dict[str, Any]) -> str:
    loops, link, late = record["loops"], record["link"], record["lateness"]
    return "\n".join(
        [
            f"lost loops {loops['lost']:.2%}; loop time p50, p95, p99: "
            + ", ".join(f"{loops[name] * 1e3:.1f}" for name in ("p50", "p95", "p99")) + " ms; "
            + f"age of the newest command: mean {loops['age_mean'] * 1e3:.1f}, p99 {loops['age_p99'] * 1e3:.1f} ms",
            f"QoC {record['qoc']:.4f} (0.5 without delay and loss), AUC {_numbers(record['auc'])} s; "
            f"replayed in the simulator {_numbers(record['auc_replayed'])} s",
            *(f"{name}: {per['bytes']:.0f} bytes/s in {per['frames']:.1f} frames/s" for name, per in link.items()),
            f"lateness, 99th percentile: emulator {late['relay']['p99'] * 1e3:.2f} ms, "
            f"samples {late['tick']['p99'] * 1e3:.2f} ms",
        ]
    )  # fmt: skip


def _numbers(values: list[float]) -> str:
    return ", ".join(f"{value:.4f}" for value in values)


def _write_csv(path: Path, table: pd.DataFrame) -> None:
    written(path, lambda file: table.to_csv(file, index=False, float_format="%.9f"))
