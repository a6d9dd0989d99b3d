"""Both controllers on every scenario, without delay and on the paper's network: experiments/results/scenarios.csv.

    python experiments/scenarios.py [--seeds 4] [--scenario doorway ...] [--out experiments/results/scenarios.csv]

Both run at 20 Hz on the same starts and loop times. The surrogate law knows no map: the last column says whether its
robots, or those of the stack, drove through obstacles. About 90 s a seed for all; rows of the scenarios that are named
replace those in the table.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir

from qocjax.config import conf_dir, load
from qocjax.config.show import ShowConfig
from qocjax.navigation import StaticMap, static_layer
from qocjax.network import Constant, LoopNetwork
from qocjax.single import Run
from qocjax.store import write_table
from qocjax.study.replayed import replay

TAU = 0.05  # s
DEADLINES = {"none": 0.0, "paper": 0.22}  # s
NO_DELAY = LoopNetwork(compute=Constant(0.0), name="none")
SCENARIOS = ("hall", "crossing", "aisle", "doorway", "junction", "circle8")


def configuration(scenario: str, controller: str) -> ShowConfig:
    """Options of one of them."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        options = [f"scenario={scenario}", f"controller={controller}", f"loop.tau={TAU}"]
        return load(ShowConfig, compose("show", options))


def in_obstacles(run: Run, room: StaticMap | None) -> bool:
    """Whether a robot's body touched an obstacle of the map, to half a cell."""
    if room is None:
        return False
    distance = np.asarray(static_layer(room).distance) - 0.5 * room.grid.resolution  # from the edge of the obstacle
    pose = np.asarray(run.pose)
    row, col, inside = (np.asarray(each) for each in room.grid.cell(pose[..., 0], pose[..., 1]))
    near = np.where(inside, distance[row, col], 0.0)
    return bool((near < float(run.robot_radius) - 0.5 * room.grid.resolution).any())


def row(scenario: str, controller: str, network: str, seeds: int) -> dict[str, object]:
    """One line of the table."""
    config = configuration(scenario, controller)
    design = replace(config.baseline(), deadline=DEADLINES[network])
    law = NO_DELAY if network == "none" else config.build_network()
    room, built = config.build_map(), config.build_controller()
    runs = [
        replay(config.build_scenario(), design, law, seed, rules=config.loop.build(), controller=built)
        for seed in range(seeds)
    ]
    arrival = np.array([np.asarray(run.arrival_time) for run in runs])
    return {
        "scenario": scenario, "robots": runs[0].pose.shape[1], "controller": controller, "network": network,
        "deadline": DEADLINES[network], "seeds": seeds, "auc": np.mean([np.asarray(run.auc).mean() for run in runs]),
        "arrived_share": np.isfinite(arrival).mean(),
        "arrival_time": np.mean(arrival[np.isfinite(arrival)]) if np.isfinite(arrival).any() else np.inf,
        "min_distance": min(float(run.min_distance) for run in runs),
        "collided_share": np.mean([bool(run.collided) for run in runs]),
        "in_obstacles_share": np.mean([in_obstacles(run, room) for run in runs]),
    }  # fmt: skip


def main() -> None:
    """Makes the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--scenario", nargs="+", choices=SCENARIOS, default=SCENARIOS)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "scenarios.csv")
    args = parser.parse_args()
    rows = []
    for scenario in args.scenario:
        for controller in ("apf", "navigation"):
            for network in DEADLINES:
                begin = time.perf_counter()
                rows.append(row(scenario, controller, network, args.seeds))
                print(f"{scenario} {controller} {network}: {time.perf_counter() - begin:.0f} s", file=sys.stderr)
    table = pd.DataFrame(rows)
    if args.out.is_file():
        old = pd.read_csv(args.out)
        table = pd.concat([old[~old["scenario"].isin(args.scenario)], table], ignore_index=True)
    order = table["scenario"].map(SCENARIOS.index)
    table = table.iloc[np.lexsort((np.arange(len(table)), order))]
    write_table(args.out.with_suffix(""), table)
    args.out.with_suffix(".parquet").unlink(missing_ok=True)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
