"""What each tick of the closed loop takes from outside: times of one command, the reference, what the network gives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from qocjax.network.schedule import Schedule
from qocjax.reference import reference_left
from qocjax.scenario import Design, Scenario

__all__ = ["Row", "Stretch", "cut", "timeline"]


class Stretch(NamedTuple):
    """A time of one command, in which the reference counts as straight; `*B` is the batch."""

    duration: Array  # h (s), 0 beyond the horizon
    left: Array  # [1 or N, *B] share of the reference's way that is left as it begins
    drawn: Array  # [1 or N, *B] what is left as it ends, less what is left as it begins, times h / 6 (s)
    bend: Array | None = None  # `drawn` less that of the stretch before


class Row(NamedTuple):
    """What one tick takes from outside."""

    tick: Array
    network: Schedule
    stretches: tuple[Stretch, ...]  # from t_p on; the second from t_p + rest on, if commands take effect there
    duration_before: Array  # of the stretch that ends at t_p (s)
    gain_before: Array | None  # the factor on its command


def timeline(
    start: Array,
    goal: Array,
    network: Schedule,
    scenario: Scenario,
    design: Design,
    rest: Array | None,
    last: Array | None,
) -> tuple[Row, Row]:
    """The rows of all ticks, leaves [P, ...], and what the row after the last would be.

    Args:
        start: [N, 3, *B] start poses.
        goal: [N, 2, *1] goals.
        network: What the network gives, leaves [P, ...].
        scenario: Reference and horizon.
        design: For tau, and for the reference `follow`.
        rest: Of the deadline (s); None where commands take effect at sampling instants only.
        last: Ticks that are run; None for P.
    """
    num_ticks, tau = network.fresh.shape[0], jnp.asarray(design.tau)
    stop = num_ticks if last is None else last
    instants = jnp.minimum(jnp.arange(num_ticks + 1) * tau, scenario.horizon)
    left = reference_left(instants, start, goal, scenario, design)
    # Not as differences of instants: in float32 those are off by 1e-4 of a tick late in a run.
    lengths = jnp.clip(scenario.horizon - instants[:-1], 0.0, tau)
    if rest is None:
        stretches = [_stretch(lengths, left[:-1], left[1:])]
    else:
        first = jnp.minimum(rest, lengths)
        inside = jnp.minimum(instants[:-1] + rest, scenario.horizon)
        between = reference_left(inside, start, goal, scenario, design)
        stretches = [_stretch(first, left[:-1], between), _stretch(lengths - first, between, left[1:])]
    gain = network.gain_start if rest is None else network.gain_mid
    ending = (stretches[-1].duration, stretches[-1].drawn, gain)
    before, bend, gains = jax.tree.map(lambda a: jnp.concatenate([jnp.zeros_like(a[:1]), a]), ending)
    bends = [stretches[0].drawn - bend[:-1], *(b.drawn - a.drawn for a, b in pairwise(stretches))]
    bent = tuple(each._replace(bend=bend) for each, bend in zip(stretches, bends, strict=True))
    at_end = Stretch(jnp.zeros_like(tau), left[stop], jnp.zeros_like(left[stop]), -bend[stop])
    rows = Row(jnp.arange(num_ticks), network, bent, before[:-1], None if gain is None else gains[:-1])
    end = Row(jnp.asarray(stop), network, (at_end,), before[stop], None if gain is None else gains[stop])
    return rows, end


def cut(stretch: Stretch, durations: Sequence[Array]) -> Iterator[Stretch]:
    """A stretch in pieces of motion, each duration [N, *B] (s)."""
    per_second = 1.0 / jnp.where(stretch.duration > 0, stretch.duration, 1.0)
    goes, past = 6.0 * per_second * stretch.drawn, jnp.zeros_like(durations[0])
    for duration in durations:
        share = duration * per_second
        yield Stretch(duration, stretch.left + past * goes, share * share * stretch.drawn)
        past = past + share


def _stretch(durations: Array, left: Array, left_after: Array) -> Stretch:
    sixths = (durations / 6.0).reshape(-1, *(1,) * (left.ndim - 1))
    return Stretch(durations, left, sixths * (left_after - left))
