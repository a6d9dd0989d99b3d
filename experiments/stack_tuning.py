"""The navigation stack tuned for a network, in Nav2's names: python -m experiments.stack_tuning [PART ...]

In the hall and in the doorway, on the paper's network at 20 Hz. `tune`: critic weights, temperature, spreads and
inflation are searched together with the deadline (CMA-ES on new seeds in each generation), and judged on fresh seeds
beside Nav2's defaults at the deadline that suits these best; twelve core-minutes for each scene.
`matters`: what each parameter matters at some deadlines around what was found, as the relative change of QoC for a
relative change of the parameter; six core-minutes a scene. `across`: what was found in one scene, judged in the other;
two core-minutes. All of them unless parts are named.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir

from qocjax import Design
from qocjax.commands.codesign import problem_of
from qocjax.config import conf_dir, load
from qocjax.config.codesign import CodesignConfig
from qocjax.search import FIRST, Problem, find
from qocjax.search.sensitivity import elasticities
from qocjax.statistics.estimates import share
from qocjax.statistics.scores import Scores

RESULTS = Path(__file__).parent / "results"
SCENES = ("hall", "doorway")
FRESH = 400  # seeds that judge; 368 without a collision show 1 %
CHOOSING = 24  # seeds on which Nav2's defaults choose their deadline
DEADLINES = (0.15, 0.2, 0.3)  # s, at which is asked what matters
NEAR = 24  # seeds of an elasticity
STEP = 0.25  # of a parameter's logarithm


def main(parts: list[str]) -> None:
    """Does what is asked for in each scene, and writes a table of it."""
    configs = {}
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        for scene in SCENES:
            configs[scene] = load(CodesignConfig, compose("codesign", ["controller=navigation", f"scenario={scene}"]))
    for part in parts:
        for scene, config in configs.items():
            table = PARTS[part](scene, config)
            table.insert(0, "scene", scene)
            _write(f"stack_{part}", scene, table)
            print((table.T if part == "tune" else table).to_string(), flush=True)


def tune(scene: str, config: CodesignConfig) -> pd.DataFrame:
    """Nav2's defaults and what a search finds, on fresh seeds."""
    begin = time.process_time()
    problem, search = problem_of(config), config.search
    found = find(problem, "cma_es", search.budget, key=config.key, block=search.block,
                 choice_seeds=search.choice_seeds, finalists=search.finalists)  # fmt: skip
    defaults = _defaults(problem, [ms / 1e3 for ms in config.sweep.deadline_ms])
    table = _judged(problem, found.design, defaults)
    return table.assign(simulations=problem.objective.simulations, core_seconds=time.process_time() - begin)


def matters(scene: str, config: CodesignConfig) -> pd.DataFrame:
    """Elasticities of QoC around what was found in the scene, at some deadlines."""
    problem, found = problem_of(config), _found(scene, config)
    seeds = range(FIRST["judge"] + FRESH, FIRST["judge"] + FRESH + NEAR)
    tables = []
    for deadline in DEADLINES:
        at = found.having({"deadline": deadline})
        table = elasticities(problem.objective, at, seeds, list(at.others), STEP)
        tables.append(table.assign(deadline=deadline))
    return pd.concat(tables)


def across(scene: str, config: CodesignConfig) -> pd.DataFrame:
    """What was found in the other scenes, judged in this one."""
    problem, seeds = problem_of(config), range(FIRST["judge"], FIRST["judge"] + FRESH)
    rows = []
    for other in SCENES:
        if other != scene:
            found = _found(other, config)
            scores, collided = problem.judged(found.having({"deadline": np.array([found.deadline])}).at([0]), seeds)
            rows.append({"found_in": other} | _columns(scores, collided, 0))
    return pd.DataFrame(rows).assign(seeds=FRESH)


def _found(scene: str, config: CodesignConfig) -> Design:
    """What `tune` found in a scene, as its table has it."""
    table = pd.read_csv(RESULTS / "stack_tune.csv").set_index(["scene", "what"]).sort_index()
    row, baseline = table.loc[scene, "tuned"], config.build_space().baseline
    return baseline.having({name: float(row[name]) for name in (*baseline.others, "deadline")})


def _defaults(problem: Problem, axis: list[float]) -> Design:
    """Nav2's defaults at the deadline of their best QoC, among those whose collisions keep the limit if any does."""
    designs = problem.space.baseline.having({"deadline": np.array(axis)})
    designs = designs.at(np.arange(len(axis)))
    scores, collided = problem.simulate(designs, range(FIRST["sweep"], FIRST["sweep"] + CHOOSING))
    kept = problem.excess(designs, collided, cautious=True) == 0
    qoc = problem.measure(scores)
    return designs.at([int(np.argmax(np.where(kept | ~kept.any(), qoc, -np.inf)))])


def _judged(problem: Problem, tuned: Design, defaults: Design) -> pd.DataFrame:
    """Both on fresh seeds: QoC, collisions, and the paired gain."""
    seeds = range(FIRST["judge"], FIRST["judge"] + FRESH)
    both = Design.of({name: np.concatenate([value, tuned.values()[name]]) for name, value in defaults.values().items()})
    scores, collided = problem.judged(both, seeds)
    rows = []
    for k, what in enumerate(("Nav2's defaults", "tuned")):
        line = {"what": what, "deadline": float(both.deadline[k])} | _columns(scores, collided, k)
        line |= (scores[k] - scores[0]).mean().columns("gain")
        rows.append(line | {name: float(np.asarray(both.others[name])[k]) for name in both.others})
    return pd.DataFrame(rows).assign(seeds=FRESH)


def _columns(scores: Scores, collided: np.ndarray, k: int) -> dict[str, float]:
    """QoC and collisions of one of the judged designs."""
    hits = share(collided[k])
    return {**scores[k].mean().columns("qoc"), "collision_share": hits.mean, "collision_low": hits.low,
            "collision_high": hits.high}  # fmt: skip


def _write(name: str, scene: str, table: pd.DataFrame) -> None:
    """Puts the rows of a scene in the place of its old ones."""
    path = RESULTS / f"{name}.csv"
    old = pd.read_csv(path) if path.is_file() else table.iloc[:0]
    pd.concat([old[old["scene"] != scene], table]).to_csv(path, index=False, float_format="%.6g")


PARTS = {"tune": tune, "matters": matters, "across": across}

if __name__ == "__main__":
    main(sys.argv[1:] or list(PARTS))
