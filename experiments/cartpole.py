"""How many poles topple, over added delay and sampling rate, beside what CLEAVE published.

    python experiments/cartpole.py            # twelve minutes; experiments/results/cartpole.csv and .png
    python experiments/cartpole.py engine     # the same plant in CLEAVE's physics engine (pip install 'pymunk<7')

CLEAVE's timing is the loop's with tau = 1/120 s, its plant's tick: a sample is sent at every so many ticks, and a
command acts from the first tick after it has come. Round trips are constant for plant and controller on one host (the
means that CLEAVE gives), and those recorded by CLEAVE over Wi-Fi, in order, for the others; the recordings are read
from ../shared/data, or from the folder that QOCJAX_DATA names, and that part is left out without them.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from qocjax import Rules
from qocjax.figures.save import save
from qocjax.figures.style import DOUBLE_COLUMN, OKABE_ITO, paper_style
from qocjax.plants import CartPole, cleave_cart_pole, simulate_cart_pole
from qocjax.statistics.estimates import share

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("QOCJAX_DATA", ROOT / ".." / "shared" / "data")) / "cleave-wifi-loop"
RESULTS = ROOT / "experiments" / "results"
TICKS_PER_SECOND, SECONDS, RUNS = 120, 300, 200
ARRIVAL = Rules("arrival")
START = 1e-3  # rad, standard deviation of the angle at the start
RATES, DELAYS_MS = (10, 12, 15, 20, 24, 30, 40, 60), (0, 25, 50)
PLANTS = {"as in CLEAVE's code": cleave_cart_pole(), "none": replace(cleave_cart_pole(), friction=0.0)}

# From the vector drawings of CLEAVE's baseline results (share, ends of its 95 % interval, runs; mean round trip, ms),
# github.com/KTH-EXPECA/CLEAVE-EdgeSys22, plots/fixed_single_loop_toppled.pdf and plots/fixed_single_loop_rtts.pdf.
PUBLISHED = {
    ("local", 10): ((0.8, 0.5, 1.0, 10), (0.9, 0.7, 1.0, 10), (1.0, 1.0, 1.0, 10)),
    ("local", 20): ((0.0, 0.0, 0.0, 10), (17 / 30, 0.4, 22 / 30, 30), (1.0, 1.0, 1.0, 30)),
    ("local", 40): ((0.0, 0.0, 0.0, 10), (0.0, 0.0, 0.0, 30), (1.0, 1.0, 1.0, 30)),
    ("local", 60): ((0.0, 0.0, 0.0, 10), (0.0, 0.0, 0.0, 30), (1.0, 1.0, 1.0, 30)),
    ("network", 10): ((0.4, 0.1, 0.7, 10), (1.0, 1.0, 1.0, 10), (1.0, 1.0, 1.0, 10)),
    ("network", 20): ((0.0, 0.0, 0.0, 10), (20 / 30, 0.5, 25 / 30, 30), (1.0, 1.0, 1.0, 30)),
    ("network", 40): ((0.0, 0.0, 0.0, 10), (1 / 30, 0.0, 0.1, 30), (26 / 30, 22 / 30, 29 / 30, 30)),
    ("network", 60): ((0.0, 0.0, 0.0, 10), (0.0, 0.0, 0.0, 30), (1.0, 1.0, 1.0, 30)),
}
LOCAL_MS = {10: 2.1, 20: 2.6, 40: 2.9, 60: 2.5}


def round_trips(setup: str, rate: int, loops: int, rng: np.random.Generator) -> np.ndarray:
    """Round trips [loops, RUNS] s, inf where lost."""
    if setup == "local":
        return np.full((loops, RUNS), 1e-3 * np.interp(rate, list(LOCAL_MS), list(LOCAL_MS.values())))
    recordings = [
        pd.read_csv(path).sort_values("seq")["rtt"].to_numpy() for path in sorted(DATA.glob("*/udpclient*.csv"))
    ]
    picked = [recordings[run % len(recordings)] for run in range(RUNS)]
    return np.stack([np.take(each, rng.integers(len(each)) + np.arange(loops), mode="wrap") for each in picked], axis=1)


def on_ticks(times: np.ndarray, between: int) -> np.ndarray:
    """Loop times of a sample in every `between` ticks, for each tick."""
    every = np.full((len(times) * between, times.shape[1]), np.inf)
    every[::between] = times
    return every


def toppled(plant: CartPole, setup: str, rate: int, delay_ms: int) -> dict[str, float]:
    """Share of the runs in which the pole topples, and the angle of the others."""
    rng = np.random.default_rng([rate, delay_ms])
    times = on_ticks(round_trips(setup, rate, SECONDS * rate, rng) + 1e-3 * delay_ms, TICKS_PER_SECOND // rate)
    start = np.zeros((RUNS, 4))
    start[:, 2] = START * rng.standard_normal(RUNS)
    end = simulate_cart_pole(plant, times, tau=1 / TICKS_PER_SECOND, deadline=1.0, rules=ARRIVAL, start=start).state
    fell = np.asarray(end.peak) >= plant.fail_angle
    found = share(fell)
    rms = np.degrees(np.sqrt(np.asarray(end.square) / SECONDS))
    return {"toppled": found.mean, "toppled_low": found.low, "toppled_high": found.high,
            "angle_rms_deg": np.median(rms[~fell]) if not fell.all() else np.nan}  # fmt: skip


def table() -> pd.DataFrame:
    """Every plant, setup, rate and delay, with what was published."""
    rows, names = [], ("published", "published_low", "published_high", "published_runs")
    setups = ("local", "network") if DATA.is_dir() else ("local",)
    for setup, friction, rate, at in product(setups, PLANTS, RATES, range(len(DELAYS_MS))):
        case = {"setup": setup, "friction": friction, "rate_hz": rate, "delay_ms": DELAYS_MS[at]}
        found = toppled(PLANTS[friction], setup, rate, DELAYS_MS[at])
        known = PUBLISHED.get((setup, rate))
        rows.append({**case, "runs": RUNS, **found, **dict(zip(names, known[at] if known else (), strict=False))})
        print(*case.values(), found["toppled"], flush=True)
    return pd.DataFrame(rows)


def draw(rows: pd.DataFrame) -> Figure:
    """Share over the rate, a panel for each setup; published shares as points."""
    setups = list(rows["setup"].unique())
    with paper_style():
        figure, axes = plt.subplots(1, len(setups), figsize=(DOUBLE_COLUMN, 2.7), sharey=True, layout="constrained",
                                    squeeze=False)  # fmt: skip
        for axis, setup in zip(axes[0], setups, strict=True):
            for colour, (at, delay_ms) in zip(OKABE_ITO, enumerate(DELAYS_MS), strict=False):
                here = rows[(rows["setup"] == setup) & (rows["delay_ms"] == delay_ms)]
                dashes = (3 * at, (3, 3))  # so that two that lie on each other both show
                for (friction, part), style in zip(here.groupby("friction", sort=False), ("-", dashes), strict=True):
                    place, label = np.log2(part["rate_hz"]), f"+{delay_ms} ms, friction {friction}"
                    axis.plot(place, part["toppled"], ls=style, color=colour, label=label)
                    axis.fill_between(place, part["toppled_low"], part["toppled_high"], color=colour, alpha=0.15, lw=0)
                known = part.dropna(subset="published")
                spread = [known["published"] - known["published_low"], known["published_high"] - known["published"]]
                axis.errorbar(np.log2(known["rate_hz"]) + 0.06 * (at - 1), known["published"], spread, fmt="o", ms=5,
                              color=colour, mec="black", mew=0.6, ecolor="black", elinewidth=0.8, capsize=2, zorder=3,
                              label=f"+{delay_ms} ms, published")  # fmt: skip
            axis.set(title={"local": "plant and controller on one host", "network": "over Wi-Fi"}[setup],
                     xlabel="sampling rate (Hz)", ylim=(-0.04, 1.04))  # fmt: skip
            axis.set_xticks(np.log2(RATES), [str(rate) for rate in RATES])
            axis.minorticks_off()
        axes[0, 0].set_ylabel("toppled within 5 min")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        order = [
            k for at in range(len(DELAYS_MS)) for k in (2 * at, 2 * at + 1, 2 * len(DELAYS_MS) + at)
        ]  # a delay a column
        figure.legend([handles[k] for k in order], [labels[k] for k in order], loc="outside lower center", ncols=3)
        plt.close(figure)
    return figure


def engine() -> pd.DataFrame:
    """Which constant delays, in ticks, topple the pole within a minute: here, and in the engine."""
    rows = []
    for rate in (10, 20, 40, 60):
        between, lags = TICKS_PER_SECOND // rate, np.arange(1, 9)
        times = on_ticks(np.broadcast_to((lags - 0.5) / TICKS_PER_SECOND, (60 * rate, 8)), between)
        end = simulate_cart_pole(cleave_cart_pole(), times, tau=1 / TICKS_PER_SECOND, deadline=1.0, rules=ARRIVAL,
                                 start=[0.0, 0.0, START, 0.0]).state  # fmt: skip
        for lag, peak in zip(lags, np.asarray(end.peak), strict=True):
            rows.append(
                {"rate_hz": rate, "delay_ticks": lag, "peak_rad": peak, "engine_peak_rad": in_engine(between, lag)}
            )
    return pd.DataFrame(rows)


def in_engine(between: int, lag: int) -> float:
    """Largest angle until it topples, of a minute in pymunk with CLEAVE's bodies."""
    import pymunk  # of this comparison alone

    plant, space = cleave_cart_pole(), pymunk.Space()
    space.gravity, group = (0.0, -plant.gravity), pymunk.ShapeFilter(group=1)
    ground = pymunk.Segment(space.static_body, (-1e6, -0.1), (1e6, -0.1), 0.1)
    cart = pymunk.Body(plant.cart_mass, pymunk.moment_for_box(plant.cart_mass, (0.3, 0.2)))
    pole = pymunk.Body(plant.pole_mass, plant.pole_inertia)
    cart.position, pole.angle = (0.0, 0.1), START
    pole.position = (-plant.pole_centre * np.sin(START), 0.2 + plant.pole_centre * np.cos(START))
    shapes = [ground, pymunk.Poly.create_box(cart, (0.3, 0.2)), pymunk.Poly.create_box(pole, (0.06, 1.2))]
    ground.friction = shapes[1].friction = np.sqrt(plant.friction)  # the engine takes the product
    ground.filter = shapes[2].filter = group
    joint = pymunk.PivotJoint(cart, pole, (0.0, 0.2))
    joint.collide_bodies = False
    space.add(cart, pole, joint, *shapes)
    force, sent, peak = 0.0, [], 0.0
    for tick in range(60 * TICKS_PER_SECOND):
        if tick % between == 0:
            asked = -np.dot(plant.gains, [cart.position.x, cart.velocity.x, pole.angle, pole.angular_velocity])
            asked = 0.0 if abs(pole.angle) > plant.give_up_angle else asked
            sent.append((tick + lag, float(np.clip(asked, -plant.max_force, plant.max_force))))
        if sent and sent[0][0] == tick:
            force = sent.pop(0)[1]
        cart.apply_force_at_local_point((force, 0.0), (0.0, 0.0))
        space.step(1 / TICKS_PER_SECOND)
        peak = max(peak, abs(pole.angle))
        if peak > plant.fail_angle:
            break
    return peak


def main() -> None:
    """The table and the figure, or the comparison with the engine."""
    jax.config.update("jax_enable_x64", True)
    if sys.argv[1:] == ["engine"]:
        found = engine()
        found.to_csv(RESULTS / "cartpole_engine.csv", index=False, float_format="%.4g")
        print(found.to_string())
        return
    rows = table()
    rows.to_csv(RESULTS / "cartpole.csv", index=False, float_format="%.4g")
    save(draw(rows), RESULTS / "cartpole")


if __name__ == "__main__":
    main()
