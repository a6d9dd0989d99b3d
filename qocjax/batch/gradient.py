"""Pathwise gradients of many designs x seeds: the derivative of each run's AUC in its design's continuous values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import DTypeLike

from qocjax import _checks
from qocjax.batch.evaluate import run_grid
from qocjax.batch.runner import Drawn, metrics
from qocjax.closed_loop import Plan
from qocjax.controllers import Controller
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario
from qocjax.tunables import CONTINUOUS

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["MODES", "gradient"]

MODES = ("forward", "reverse")

# Forward mode carries one tangent per parameter along; from this many on, reverse mode is cheaper.
_FEW_PARAMETERS = 3

# Values that act on each robot alone; the others act on pairs of robots.
_OF_A_ROBOT = ("kappa", "gamma", "v_max", "omega_max")


def gradient(
    scenario: Scenario,
    designs: Design,
    network: Network,
    seeds: Sequence[int],
    wrt: Sequence[str] = ("kappa", "gamma"),
    *,
    mode: str | None = None,
    rules: Rules | None = None,
    key: int = 0,
    dtype: DTypeLike = jnp.float32,
    max_runs: int = 512,
    controller: Controller | None = None,
) -> xr.Dataset:
    """Simulates every design with every seed, and differentiates each run.

    Reverse mode goes back through the whole horizon in blocks of ticks that are computed again on the way
    (checkpoints), so its memory is that of a few hundred states per run. A mean of these derivatives over seeds need
    not be useful where robots contest their goal: the tails are heavy.

    Args:
        scenario: As for `evaluate`.
        designs: As for `evaluate`.
        network: As for `evaluate`.
        seeds: As for `evaluate`.
        wrt: Continuous values of a design to differentiate in, those of `others` by their full names.
        mode: `forward` or `reverse`; by default forward for up to three values. `arrival` knows forward only.
        rules: As for `evaluate`.
        key: As for `evaluate`.
        dtype: As for `evaluate`.
        max_runs: Runs of one batch with two robots.
        controller: What computes the commands, by default the surrogate law; one that says it is smooth.

    Returns:
        Over (design, seed): `auc`, the mean over robots, and its derivative `d_auc_<name>` for each name.

    Raises:
        ValueError: An unknown name or mode, or what `evaluate` raises.
    """
    rules = rules or Rules()
    if controller is not None and not controller.smooth:
        raise ValueError(f"controller: got {type(controller).__name__}, which does not say that it is smooth, expected "
                         "one that has derivatives")  # fmt: skip
    known = (*CONTINUOUS, *designs.others)
    names = tuple(_checks.choice("wrt", name, known) for name in wrt)
    if not names or len(set(names)) != len(names):
        raise ValueError(f"wrt: got {list(wrt)}, expected at least one of {', '.join(known)}, each once")
    for name in set(names) & set(scenario.robot.unread):
        raise ValueError(f"wrt: got {name}, which the robot ({type(scenario.robot).__name__}) does not read")
    few = len(names) <= _FEW_PARAMETERS or rules.actuation == "arrival"
    mode = _checks.choice("mode", mode or ("forward" if few else "reverse"), MODES)
    if mode == "reverse" and rules.actuation == "arrival":
        raise ValueError("mode: got reverse with the actuation arrival, expected forward")
    runs = run_grid(
        scenario, designs, network, seeds, _AucGradient(names, mode),
        rules=rules, key=key, dtype=dtype, max_runs=_checks.count("max_runs", max_runs), in_blocks=mode == "reverse",
        controller=controller,
    )  # fmt: skip
    return runs.assign_attrs(mode=mode)


@dataclass(frozen=True)
class _AucGradient:
    """Measures the AUC of each run, mean over robots, and its derivatives."""

    names: tuple[str, ...]
    mode: str

    def __call__(self, scenario: Scenario, design: Design, drawn: Drawn, ticks: Array, plan: Plan) -> dict[str, Array]:
        """The measure; one copy of each value per run makes the derivatives those of single runs."""
        start = drawn.start
        shape, own = (jnp.shape(design.kappa)[1], start.shape[-1]), design.values()
        values = {name: jnp.broadcast_to(own[name], (1, *shape)) for name in self.names}
        if self.mode == "reverse":  # spread, all values are read alike: XLA's backward loop is twice as fast
            everything = {
                name: _spread(own[name], name, start.shape[0], shape) for name in own if name not in ("tau", "deadline")
            }
            design = design.having(everything)

        def auc(values: dict[str, Array]) -> Array:
            # Spread over robots ahead of the loop, so that their derivatives are summed once and not in each tick.
            spread = {name: _spread(value, name, start.shape[0], shape) for name, value in values.items()}
            measured = metrics(scenario, design.having(spread), drawn, ticks, plan)
            return jnp.mean(measured["auc"], axis=0)

        if self.mode == "reverse":
            cost, pull = jax.vjp(auc, values)
            (slopes,) = pull(jnp.ones_like(cost))
            return {"auc": cost} | {f"d_auc_{name}": slopes[name][0] for name in self.names}
        basis = {
            name: jnp.zeros((len(self.names), 1, *shape), start.dtype).at[k].set(1.0)
            for k, name in enumerate(self.names)
        }
        cost, slopes = jax.vmap(lambda tangent: jax.jvp(auc, (values,), (tangent,)), out_axes=(None, 0))(basis)
        return {"auc": cost} | {f"d_auc_{name}": slopes[k] for k, name in enumerate(self.names)}


def _spread(value: Array, name: str, robots: int, shape: tuple[int, int]) -> Array:
    """One copy for each run, and for each robot where the value acts on robots alone."""
    return jnp.broadcast_to(value, (robots if name in _OF_A_ROBOT else 1, *shape))
