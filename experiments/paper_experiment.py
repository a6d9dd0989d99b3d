"""The paper's experiment as one command: configured delays, real middleware, bags, E(phi) against S(phi).

    python -m experiments.paper_experiment [--delays 0 100 ...] [--runs 3] [testbed option=value ...]

For each D_cfg the robots of the testbed run in real time, over ROS 2 and Fast DDS unless told otherwise, and obey
each command D_cfg after the stamp of its state, as behind the paper's delay node. Each run is recorded as a rosbag2.
The bags are read as a robot's are (`qocjax.validate measured=recorded`): AUC, E(phi), regimes and rank correlation with
S(phi) of the simulator, whose loop times are those that the run with the longest delay measured. Runs that the folder
holds and that were not rejected are kept; a folder is for one set of options.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir

from experiments.dds_testbed.config import read_config
from qocjax import validate
from qocjax.config import conf_dir, load
from qocjax.config.validate import ValidateConfig

__all__ = ["bags_of", "main", "measure", "options_of", "validation"]

ROOT = Path(__file__).resolve().parents[1]
DELAYS = (0, 50, 100, 150, 200, 250, 300, 400, 500, 600, 700, 800)  # ms
_ALWAYS = ("middleware=fastdds", "network=paper", "loop.tau=0.05", "loop.actuation=deadline", "bag=true")
_SHARED = ("scenario", "robot", "controller", "loop")  # options that say as much of S
_ATTEMPTS = 3


def options_of(delay_ms: float, run: int, further: Iterable[str]) -> list[str]:
    """Options of the testbed for one run, each with random numbers of its own."""
    return [*_ALWAYS, *further, f"deadline_ms={delay_ms:g}", f"key={run}"]


def _place(folder: Path, delay_ms: float, run: int) -> Path:
    return folder / "runs" / f"delay_{delay_ms:g}" / str(run)


def measure(folder: Path, delays: Iterable[float], runs: int, further: Iterable[str]) -> list[str]:
    """Makes the runs that the folder does not hold; a rejected one is made again, a few times.

    Returns:
        What is to be said of runs that were rejected every time; they are not among the bags.
    """
    said = []
    for delay in delays:
        for run in range(runs):
            place, options = _place(folder, delay, run), options_of(delay, run, further)
            why = _reasons(place)
            for _ in range(_ATTEMPTS):
                if why == []:
                    break
                print(f"\nD_cfg = {delay:g} ms, run {run}", flush=True)
                command = [sys.executable, "-m", "experiments.dds_testbed", *options, f"folder={place.resolve()}"]
                status = subprocess.run(command, cwd=ROOT).returncode
                if status not in (0, 3):
                    raise SystemExit(status)
                why = _reasons(place)
            if why:
                said.append(f"D_cfg = {delay:g} ms, run {run}: left out, rejected: {'; '.join(why)}")
    return said


def _reasons(place: Path) -> list[str] | None:
    """Why a run was rejected; None where there is none."""
    record = place / "record.json"
    if not record.exists():
        return None
    found: list[str] = json.loads(record.read_text(encoding="utf-8"))["rejected"]
    return found


def bags_of(folder: Path, delays: Iterable[float], runs: int) -> Path:
    """A folder with the bags that count, by D_cfg.

    Raises:
        ValueError: None does.
    """
    bags = folder / "bags"
    bags.mkdir(parents=True, exist_ok=True)
    for old in bags.iterdir():
        old.unlink()
    for delay in delays:
        for run in range(runs):
            place = _place(folder, delay, run)
            if _reasons(place) == []:
                (bags / f"delay_{delay:g}_run_{run}").symlink_to((place / "bag").resolve(), target_is_directory=True)
    if not any(bags.iterdir()):
        raise ValueError(f"{folder}: got no run that counts, expected a quieter machine")
    return bags


def _longest(folder: Path, delays: Iterable[float], runs: int) -> Path:
    """Loops of the run that counts with the longest D_cfg, in which the network's times are whole."""
    places = [_place(folder, delay, run) for delay in sorted(delays, reverse=True) for run in range(runs)]
    return next(place for place in places if _reasons(place) == []) / "loops_0.csv"


def validation(folder: Path, delays: Iterable[float], runs: int, further: Iterable[str]) -> validate.Outcome:
    """E of the runs that count against S, for their scenario, robot, law and rules."""
    bags, loops = bags_of(folder, delays, runs), _longest(folder, delays, runs)
    shared = [each for each in further if each.split("=")[0].split(".")[0] in _SHARED]
    options = [
        "measured=recorded", f"measured.path={bags}", "measured.labels.pattern='delay_{d_cfg_ms}_run_{run}'",
        "measured.label=d_cfg_ms", f"validation.delay_ms=[{','.join(f'{delay:g}' for delay in delays)}]",
        "validation.seeds=8", "network=trace", f"network.path={loops}", "network.column=loop_time", "network.unit=s",
        "network.sequence=sequence",
    ]  # fmt: skip
    of_runs = read_config(options_of(0.0, 0, further))
    options += [*shared, f"loop.tau={of_runs.loop.tau}", f"network.period={of_runs.loop.tau}",
                f"scenario.horizon={of_runs.scenario.horizon}"]  # fmt: skip
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        composed = load(ValidateConfig, compose("validate", options))
    return validate.run(composed, folder / "validation")


def main(arguments: list[str]) -> int:
    """Command line; 2 for bad input or a system that does not allow it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--delays", type=float, nargs="+", default=DELAYS, metavar="MS", help="D_cfg (ms)")
    parser.add_argument("--runs", type=int, default=1, help="runs of each")
    parser.add_argument("--folder", type=Path, default=Path("results/paper_experiment"), help="of runs and results")
    parser.add_argument("options", nargs="*", metavar="option=value", help="of the testbed")
    given = parser.parse_intermixed_args(arguments)
    try:
        delays = sorted(set(given.delays))
        if given.runs < 1 or len(delays) < 3 or not np.isfinite(delays).all():
            raise ValueError(f"got {len(delays)} delays and {given.runs} runs, expected 3 delays and 1 run or more")
        for delay in delays:
            read_config(options_of(delay, 0, given.options)).build_plan(False, Path())
        said = measure(given.folder, delays, given.runs, given.options)
        print("\n" + validate.report(validation(given.folder, delays, given.runs, given.options)))
    except (ValueError, TypeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print("\n".join([*said, f"Runs, bags, tables and figures are in {given.folder}"]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
