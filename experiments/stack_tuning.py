"""The navigation stack tuned for a network, in Nav2's names: python experiments/stack_tuning.py [SCENE ...]

In the hall and in the doorway, on the paper's network at 20 Hz: critic weights, temperature, spreads and inflation are
searched together with the deadline (CMA-ES on new seeds in each generation), and judged on fresh seeds beside Nav2's
defaults at the deadline that suits these best. Then what each parameter matters at some deadlines, around what was
found: relative change of QoC for a relative change of the parameter. Twenty minutes on two cores for each scene, of
which search and judgement take a quarter of an hour.
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

RESULTS = Path(__file__).parent / "results"
SCENES = ("hall", "doorway")
FRESH = 400  # seeds that judge; 368 without a collision show 1 %
CHOOSING = 24  # seeds on which Nav2's defaults choose their deadline
DEADLINES = (0.15, 0.2, 0.3)  # s, at which is asked what matters
NEAR = 24  # seeds of an elasticity
STEP = 0.25  # of a parameter's logarithm


def main(scenes: list[str]) -> None:
    """Tunes and judges in each scene, then asks what matters around what was found; a table of each."""
    for scene in scenes:
        with initialize_config_dir(str(conf_dir()), version_base="1.3"):
            config = load(CodesignConfig, compose("codesign", ["controller=navigation", f"scenario={scene}"]))
        begin = time.process_time()
        problem, search = problem_of(config), config.search
        found = find(problem, "cma_es", search.budget, key=config.key, block=search.block,
                     choice_seeds=search.choice_seeds, finalists=search.finalists)  # fmt: skip
        defaults = _defaults(problem, [ms / 1e3 for ms in config.sweep.deadline_ms])
        table = _judged(problem, found.design, defaults)
        table.insert(0, "scene", scene)
        table["simulations"] = problem.objective.simulations
        table["core_seconds"] = time.process_time() - begin
        _write("stack_tuning", scene, table)
        print(table.T.to_string(), flush=True)
        matters = _matters(problem, found.design)
        matters.insert(0, "scene", scene)
        _write("stack_matters", scene, matters)
        print(matters.to_string(index=False), flush=True)


def _defaults(problem: Problem, axis: list[float]) -> Design:
    """Nav2's defaults at the deadline that is best for them among those whose collisions keep the limit."""
    designs = problem.space.baseline.having({"deadline": np.array(axis)})
    designs = designs.at(np.arange(len(axis)))
    scores, collided = problem.simulate(designs, range(FIRST["sweep"], FIRST["sweep"] + CHOOSING))
    fitness = problem.fitness(scores, problem.excess(designs, collided, cautious=True))
    return designs.at([int(np.argmax(fitness))])


def _judged(problem: Problem, tuned: Design, defaults: Design) -> pd.DataFrame:
    """Both on fresh seeds: QoC, collisions, and the paired gain."""
    seeds = range(FIRST["judge"], FIRST["judge"] + FRESH)
    both = Design.of({name: np.concatenate([value, tuned.values()[name]]) for name, value in defaults.values().items()})
    scores, collided = problem.judged(both, seeds)
    rows = []
    for k, what in enumerate(("Nav2's defaults", "tuned")):
        hits = share(collided[k])
        line = {"what": what, "deadline": float(both.deadline[k]), **scores[k].mean().columns("qoc")}
        line |= {"collision_share": hits.mean, "collision_low": hits.low, "collision_high": hits.high}
        line |= (scores[k] - scores[0]).mean().columns("gain")
        rows.append(line | {name: float(np.asarray(both.others[name])[k]) for name in both.others})
    return pd.DataFrame(rows).assign(seeds=FRESH)


def _matters(problem: Problem, design: Design) -> pd.DataFrame:
    """Elasticities of QoC at some deadlines."""
    tables = []
    for deadline in DEADLINES:
        at = Design.of({name: float(np.asarray(value).ravel()[0]) for name, value in design.values().items()})
        seeds = range(FIRST["judge"] + FRESH, FIRST["judge"] + FRESH + NEAR)
        found = elasticities(problem.objective, at.having({"deadline": deadline}), seeds, list(at.others), STEP)
        tables.append(found.assign(deadline=deadline))
    return pd.concat(tables)


def _write(name: str, scene: str, table: pd.DataFrame) -> None:
    """Puts the rows of a scene in the place of its old ones."""
    path = RESULTS / f"{name}.csv"
    old = pd.read_csv(path) if path.is_file() else table.iloc[:0]
    pd.concat([old[old["scene"] != scene], table]).to_csv(path, index=False, float_format="%.6g")


if __name__ == "__main__":
    main(sys.argv[1:] or list(SCENES))
