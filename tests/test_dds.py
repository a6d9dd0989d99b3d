"""ROS 2 transport: the scan against an event-driven simulation, closed forms, known behaviour of real middleware."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import slow_dds
import yaml
from scipy import stats

from qocjax.config import conf_dir
from qocjax.network import (
    Constant,
    GilbertElliott,
    IndependentLoss,
    Load,
    Network,
    ShiftedGamma,
    TruncatedNormal,
    loop_times,
)
from qocjax.network.dds import TIMERS, DdsNetwork, Profile, Topic, loop_statistics
from qocjax.network.dds.delivery import best_effort, in_sequence, missed_periods, queued
from qocjax.network.dds.statistics import command_ages, miss_runs
from qocjax.network.dds.transport import TopicDraws, carry, draw_topics
from qocjax.transport.transport import Sent, run_transport

MILD = ShiftedGamma(0.0, (10 / 3) ** 2, 0.01 * 0.3**2)  # mean 10 ms, standard deviation 3 ms
WILD = ShiftedGamma(0.0, (20 / 12) ** 2, 0.02 * 0.6**2)  # mean 20 ms, standard deviation 12 ms
BURSTS = GilbertElliott(0.03, 0.2, 0.01, 0.9)
TICKS = 400


def same_draws(draws: TopicDraws, back: Any, tau: float) -> slow_dds.Fate:
    """The fate of each message from the arrays that the scan reads, for robot 0."""
    one = jax.tree.map(lambda a: np.asarray(a)[0], draws)
    returning = np.asarray(back.chance)[0]

    def fate(kind: str, number: int, time: float, packet: int | None = None, pieces: int = 1) -> float | None:
        fates = {"data": one.data, "heartbeat": one.heartbeats, "acknack": one.acknacks, "packet": one.packets}[kind]
        place: Any = number % fates.delay.shape[0] if packet is None else (number % fates.delay.shape[0], packet)
        chance = returning if kind == "acknack" else one.link.chance
        tick = min(int(math.floor(time / tau + 1e-3)), chance.size - 1)
        lost = chance[tick] if pieces == 1 else 1.0 - (1.0 - chance[tick]) ** pieces
        return None if fates.level[place] < lost else float(fates.delay[place])

    return fate


def writes(kind: str, rng: np.random.Generator, tau: float) -> np.ndarray:
    times = np.arange(TICKS) * tau
    if kind == "irregular":  # pauses, bunches, and some that are never written
        times = np.sort(times + rng.exponential(2 * tau, TICKS) + 0.35 * rng.integers(0, 3, TICKS))
        times[-40:] = np.inf
    return times


FAST_DDS = Profile(**TIMERS["fastdds"])
PROFILES = {
    "default": Profile(),
    "depth 1": Profile(depth=1),
    "depth 3, reader 1": Profile(depth=3, reader_depth=1),
    "keep all": Profile(depth=None, reader_depth=4),
    "periodic": Profile(depth=30, piggyback="never", heartbeat_period=0.0713, acknack_delay=0.004, repair_delay=0.003),
    "eager": Profile(depth=20, nack_period=0.0),
    "slow": Profile(depth=40, acknack_delay=0.05, nack_period=0.02, repair_delay=0.01),
    "lifespan": Profile(depth=20, lifespan=0.11),
    "fast": replace(FAST_DDS, depth=10),
    "fast, depth 1": replace(FAST_DDS, depth=1),
    "fast, keep all": replace(FAST_DDS, depth=None),
    "fast, lifespan": replace(FAST_DDS, depth=6, lifespan=0.15, acknack_delay=0.03),
    "lifespan from reception": Profile(depth=20, lifespan=0.11, lifespan_from="reception"),
}
CHANNELS = {
    "constant": (Constant(0.01), IndependentLoss(0.15)),
    "mild": (MILD, IndependentLoss(0.1)),
    "wild": (WILD, IndependentLoss(0.2)),
    "bursts": (MILD, BURSTS),
}


QUICK = {
    ("default", "mild"), ("depth 1", "constant"), ("depth 3, reader 1", "bursts"), ("keep all", "wild"),
    ("periodic", "bursts"), ("fast, lifespan", "wild"), ("lifespan", "wild"),
    ("lifespan from reception", "wild"),
}  # fmt: skip
PAIRS = [
    pytest.param(name, channel, marks=[] if (name, channel) in QUICK else pytest.mark.slow)
    for name in PROFILES
    for channel in CHANNELS
]


@pytest.mark.parametrize(("name", "channel"), PAIRS)
def test_the_scan_is_the_event_driven_protocol(name: str, channel: str) -> None:
    law, loss = CHANNELS[channel]
    profile, tau = PROFILES[name], 0.0213  # no timer ends exactly when a sample is written
    topic = Topic(law, loss, profile=profile, payload=400)  # three repairs a packet
    run = jax.jit(lambda write, draws, back: carry(write, draws, back, topic))
    for seed, writing in ((1, "regular"), (2, "irregular"), (3, "regular")):
        draws, other = draw_topics((topic, topic), jax.random.key(seed), TICKS, 1, tau)
        write = writes(writing, np.random.default_rng(seed), tau)
        one, back = (jax.tree.map(lambda a: a[0], each) for each in (draws, other.link))
        took, traffic = run(jnp.asarray(write), one, back)
        per_packet = profile.repairs_per_packet(topic.payload)
        fate, most = same_draws(draws, other.link, tau), draws.heartbeats.delay.shape[1]
        kind = slow_dds.ConfirmingPair if profile.confirms else slow_dds.Pair
        pair = kind(list(write), profile, per_packet, most, fate)
        slow = pair.run()
        begin = write if profile.lifespan_from == "source" else slow.received
        late = {k: t for k, t in slow.handed.items() if t - begin[k] > profile.lifespan}
        expected = np.full(TICKS, np.inf)
        for k, time in slow.handed.items():
            expected[k] = time - write[k] if k not in late else np.inf
        np.testing.assert_allclose(took, expected, rtol=1e-9, atol=1e-9)
        end = np.nanmax(np.where(np.isfinite(write), write, np.nan)) + 0.987

        def upto(times: Any, end: float = end) -> np.ndarray:
            return np.sort([t for t in np.ravel(times) if t < end])

        np.testing.assert_allclose(upto(traffic.acknacks), upto(slow.asked + slow.confirmed), atol=1e-9)
        np.testing.assert_allclose(upto(traffic.heartbeats), upto(slow.heartbeats), atol=1e-9)
        acknowledged = 4 if profile.confirms else 0  # while a request for it was on its way, and yet sent again here
        assert abs(int(traffic.repair_samples.sum()) - slow.repaired) <= acknowledged
        assert abs(int(traffic.repair_packets.sum()) - slow.packets) <= acknowledged
        if profile.confirms:
            assert int(jnp.isfinite(traffic.carrying).sum()) == pair.carried


@pytest.mark.parametrize("channel", CHANNELS)
def test_best_effort_is_the_event_driven_reader(channel: str) -> None:
    law, loss = CHANNELS[channel]
    topic = Topic(law, loss, profile=Profile("best_effort"))
    draws, other = draw_topics((topic, topic), jax.random.key(5), TICKS, 1, 0.02)
    write = writes("irregular", np.random.default_rng(5), 0.02)
    one, back = (jax.tree.map(lambda a: a[0], each) for each in (draws, other.link))
    took, _ = carry(jnp.asarray(write), one, back, topic)
    handed = slow_dds.best_effort(list(write), same_draws(draws, other.link, 0.02))
    expected = [handed[k] - write[k] if k in handed else np.inf for k in range(TICKS)]
    np.testing.assert_allclose(took, expected, rtol=1e-9, atol=1e-9)


def test_profiles_of_middlewares_are_those_of_the_configuration() -> None:
    values: dict[str, Any] = {}
    for name, middleware in (("reliable", "cyclonedds"), ("reliable_fastdds", "fastdds")):
        values |= yaml.safe_load((conf_dir() / "profile" / f"{name}.yaml").read_text(encoding="utf-8"))
        values.pop("defaults", None)
        expected = TIMERS[middleware] | {"lifespan_from": "source"}  # the model's choice
        assert Profile(**values) == Profile(reader_depth=10, **expected)


def network(law: Any = MILD, **qos: Any) -> DdsNetwork:
    topic = Topic(law, in_order=True)
    return DdsNetwork(uplink=topic, compute=Constant(0.001), downlink=topic).with_qos(**qos)


def sent(loss: Any, seeds: int = 12, **qos: Any) -> Sent:
    """Loops of one robot at 50 Hz, 20 s; one program for each QoS."""
    return run_transport(network(**qos), loss, jax.random.split(jax.random.key(7), seeds), 1000, 1, 0.02)


def drawn(loss: Any, **qos: Any) -> np.ndarray:
    """Loop times [S, P]."""
    return sent(loss, **qos).loop_times[:, :, 0]


BEST_EFFORT: dict[str, Any] = {"reliability": "best_effort"}
DEPTH_1: dict[str, Any] = {"depth": 1, "reader_depth": 1}
DEPTH_10: dict[str, Any] = {"depth": 10, "reader_depth": 10}


@pytest.fixture(scope="module")
def lossy() -> dict[str, np.ndarray]:
    profiles = {"best effort": BEST_EFFORT, "1": DEPTH_1, "10": DEPTH_10, "all": {"depth": None}}
    return {name: drawn(IndependentLoss(0.1), **qos) for name, qos in profiles.items()}


@pytest.mark.slow
def test_without_loss_reliable_is_best_effort_exactly() -> None:
    np.testing.assert_array_equal(drawn(IndependentLoss(), **BEST_EFFORT), drawn(IndependentLoss(), **DEPTH_10))


def test_best_effort_loses_what_either_way_loses(lossy: dict[str, np.ndarray]) -> None:
    lost = np.isinf(lossy["best effort"])
    assert lost.mean() == pytest.approx(1 - 0.9**2, abs=4 * stats.sem(lost.mean(axis=1)))


def test_depth_1_is_no_better_than_best_effort(lossy: dict[str, np.ndarray]) -> None:
    """A new sample replaces the lost one before it is repaired."""
    better = np.isfinite(lossy["1"]) & np.isinf(lossy["best effort"])
    assert better[:, :-20].mean() < 2e-3
    assert abs(np.isinf(lossy["1"]).mean() - np.isinf(lossy["best effort"]).mean()) < 2e-3


def test_depth_10_trades_losses_for_late_and_old_commands(lossy: dict[str, np.ndarray]) -> None:
    """Measured: 20 % to 0.5 % lost, 95th percentile from 29 to 164 ms, mean age from 38 to 67 ms."""
    effort, reliable = (loop_statistics(lossy[name][:, :-50], 0.02) for name in ("best effort", "10"))
    assert effort["lost"] == pytest.approx(0.19, abs=0.015) and reliable["lost"] < 0.02
    assert effort["p95"] == pytest.approx(0.029, rel=0.1) and reliable["p95"] == pytest.approx(0.164, rel=0.2)
    assert reliable["p99"] == pytest.approx(0.212, rel=0.2) and reliable["p50"] == pytest.approx(0.0286, rel=0.2)
    assert effort["age_mean"] == pytest.approx(0.038, rel=0.2) and reliable["age_mean"] == pytest.approx(0.067, rel=0.2)


def test_keep_all_loses_nothing_before_the_end(lossy: dict[str, np.ndarray]) -> None:
    assert np.isfinite(lossy["all"][:, :-50]).all()
    assert np.isinf(lossy["10"]).mean() < np.isinf(lossy["1"]).mean()


def test_repaired_loops_come_in_bursts(lossy: dict[str, np.ndarray]) -> None:
    """Samples that waited for one repair are handed over at one moment: loop times fall by tau from one to the next."""
    share = {}
    for name in ("10", "best effort"):
        steps = np.diff(np.where(np.isfinite(lossy[name]), lossy[name], 1e6), axis=1)
        share[name] = np.isclose(steps, -0.02, rtol=0, atol=1e-9).mean()
    assert share["10"] > 0.1 and share["best effort"] < 1e-3
    late = np.isfinite(lossy["10"]) & (lossy["10"] > 0.06)
    assert miss_runs(late) > 2 / (1 - late.mean())  # twice those of independent delays


def handed_over(write: np.ndarray, delays: np.ndarray) -> np.ndarray:
    """Which samples a BEST_EFFORT reader takes, with the times at which it has them, [R, P]."""
    take = jax.vmap(lambda written, arrival: best_effort(written, arrival, Profile("best_effort")))
    return np.asarray(take(jnp.asarray(write), jnp.asarray(write + delays)))


def test_reordering_alone_loses_best_effort_samples() -> None:
    """Measured at 100 Hz with heavy jitter (mean 20, standard deviation 12 ms): 44 % of the round trips."""
    rng, shape, scale = np.random.default_rng(1), (20, 2000), 0.02 * 0.6**2
    up = handed_over(np.tile(np.arange(2000) * 0.01, (20, 1)), rng.gamma((20 / 12) ** 2, scale, shape))
    down = handed_over(np.sort(up, axis=1), rng.gamma((20 / 12) ** 2, scale, shape))
    assert np.isinf(down).mean() == pytest.approx(0.44, abs=0.03)


@pytest.mark.slow
def test_reordering_loses_no_reliable_sample() -> None:
    topic = Topic(WILD)
    net = DdsNetwork(uplink=topic, downlink=topic)
    keys = jax.random.split(jax.random.key(7), 4)
    assert np.isfinite(np.asarray(loop_times(net, keys, 1000, 1, 0.01))[:, :-50]).all()
    lost = np.isinf(np.asarray(loop_times(net.with_qos(**BEST_EFFORT), keys, 1000, 1, 0.01)))
    assert lost.mean() == pytest.approx(0.45, abs=0.03)


def test_exponential_reordering_has_a_closed_form() -> None:
    """A sample that takes x survives if each later one, sent j tau after it, takes longer than x - j tau."""
    mean, tau = 0.02, 0.01
    x = np.linspace(0.0, 0.6, 60_001)
    later = np.prod([np.exp(-np.maximum(x - j * tau, 0.0) / mean) for j in range(1, 61)], axis=0)
    survives = np.trapezoid(np.exp(-x / mean) / mean * later, x)
    rng = np.random.default_rng(2)
    kept = np.isfinite(handed_over(np.tile(np.arange(1000) * tau, (40, 1)), rng.exponential(mean, (40, 1000))))[:, :-60]
    assert kept.mean() == pytest.approx(survives, abs=4 * stats.sem(kept.mean(axis=1)))


def test_a_repair_takes_one_exchange() -> None:
    """With constant delays: the next sample shows the gap, an ACKNACK goes up, the repair comes down."""
    tau, one_way = 0.03, 0.01
    topic = Topic(Constant(one_way), IndependentLoss(0.5), Profile(depth=50))
    draws, _ = draw_topics((topic, topic), jax.random.key(0), 20, 1, tau)
    one = jax.tree.map(lambda a: a[0], draws)
    level = jnp.ones(20).at[4].set(0.0)  # only sample 4 is lost
    calm = replace(one, data=replace(one.data, level=level), acknacks=jax.tree.map(jnp.ones_like, one.acknacks),
                   packets=jax.tree.map(jnp.ones_like, one.packets))  # fmt: skip
    calm = replace(calm, acknacks=replace(calm.acknacks, delay=one.acknacks.delay),
                   packets=replace(calm.packets, delay=one.packets.delay))  # fmt: skip
    took, traffic = jax.jit(lambda write, draws, back: carry(write, draws, back, topic))(
        jnp.arange(20) * tau, calm, one.link
    )
    late = tau + 3 * one_way
    expected = np.full(20, one_way)
    expected[4:6] = late, late - tau  # sample 5 waits for sample 4
    np.testing.assert_allclose(took, expected, atol=1e-12)
    assert int(traffic.repair_samples.sum()) == 1 and int(jnp.isfinite(traffic.acknacks).sum()) >= 1


def test_a_burst_loses_repairs_and_acknacks_too() -> None:
    """In a channel that is bad for a second nothing comes through, whatever is sent again."""
    channel_of = GilbertElliott(0.02, 0.02)  # spells of 50 periods = 1 s
    assert np.isinf(drawn(channel_of, **DEPTH_10)).mean() > 0.3  # 10 samples of 50 survive a spell
    assert np.isinf(drawn(channel_of, depth=None)[:, :-200]).mean() < 0.05


def test_lifespan_bounds_what_is_handed_over() -> None:
    times = drawn(IndependentLoss(0.1), lifespan=0.06, **DEPTH_10)
    assert times[np.isfinite(times)].max() <= 2 * 0.06 + 0.001 + 1e-6  # up and down, and the computation
    assert np.isinf(times).mean() > 0.01


def test_a_lifespan_from_reception_lets_old_samples_through() -> None:
    """A way of 150 ms under a lifespan of 100 ms: all are handed over, or none, as Cyclone DDS and Fast DDS do."""
    write = jnp.arange(5) * 0.1
    for lifespan_from, expected in (("reception", write + 0.15), ("source", jnp.full(5, jnp.inf))):
        profile = Profile("best_effort", lifespan=0.1, lifespan_from=lifespan_from)
        np.testing.assert_allclose(best_effort(write, write + 0.15, profile), expected)
        held = in_sequence(
            write, write + 0.15, jnp.full(5, jnp.inf), Profile(lifespan=0.1, lifespan_from=lifespan_from)
        )
        np.testing.assert_allclose(held, expected)
    released = jnp.full(3, jnp.inf).at[0].set(0.4)  # what waits behind a gap for longer than that is old by either rule
    received, profile = jnp.asarray([jnp.inf, 0.25, 0.35]), Profile(lifespan=0.1, lifespan_from="reception")
    np.testing.assert_allclose(in_sequence(write[:3], received, released, profile), [jnp.inf, jnp.inf, 0.4])


def test_same_chance_for_all_profiles(lossy: dict[str, np.ndarray]) -> None:
    """Common random numbers: what nothing holds up takes the same time in every profile."""
    direct = np.isfinite(lossy["best effort"]) & np.isclose(lossy["best effort"], lossy["10"], atol=1e-9)
    assert direct.mean() > 0.3
    fewer = np.isinf(drawn(IndependentLoss(0.05), **BEST_EFFORT))
    assert np.all(np.isinf(lossy["best effort"])[fewer])  # what is lost at 5 % is lost at 10 %


def test_delivery_rules_by_hand() -> None:
    write = jnp.arange(6) * 0.1
    arrival = jnp.asarray([0.05, 0.45, 0.25, jnp.inf, 0.41, 0.56])
    np.testing.assert_allclose(
        best_effort(write, arrival, Profile("best_effort")), [0.05, jnp.inf, 0.25, jnp.inf, 0.41, 0.56]
    )
    released = jnp.full(6, jnp.inf).at[3].set(0.5)
    everything = in_sequence(write, arrival, released, Profile(depth=None))
    np.testing.assert_allclose(everything, [0.05, 0.45, 0.45, jnp.inf, 0.5, 0.56])
    newest = in_sequence(write, arrival, released, Profile(depth=None, reader_depth=1))
    np.testing.assert_allclose(newest, [0.05, jnp.inf, 0.45, jnp.inf, 0.5, 0.56])
    np.testing.assert_allclose(queued(arrival), [0.05, 0.45, 0.45, jnp.inf, 0.45, 0.56], atol=1e-4)
    handed = jnp.asarray([0.05, jnp.inf, 0.25, jnp.inf, 0.41, 0.56])
    assert int(missed_periods(handed, 0.1, 1.0)) == 1 + 1 + 1 + 4  # gaps of 0.2, 0.16, 0.15 and 0.44 s
    assert int(missed_periods(handed, math.inf, 1.0)) == 0 == int(missed_periods(handed * jnp.inf, 0.1, 1.0))


def test_ages_by_hand() -> None:
    times = np.array([[0.15, np.inf, 0.05, 0.3, 0.1, 0.1]])
    np.testing.assert_allclose(command_ages(times, 0.1), [[np.inf, np.inf, 0.2, 0.1, 0.2, 0.1]], atol=1e-12)
    assert miss_runs(np.array([[True, True, False, True, False]])) == 1.5


def test_traffic_is_counted_in_each_second() -> None:
    count = sent(IndependentLoss(0.1), **DEPTH_10).uplink
    profile = network(**DEPTH_10).uplink.profile
    assert np.all(count["data"] == 50)
    # Of 50 samples a second 5 are lost; a repair that is lost on its way is sent again.
    assert count["repairs"].mean() == pytest.approx(5 / 0.9, rel=0.2)
    data, (packet, sample) = profile.data_bytes(100) + 32, profile.repair_bytes(100)
    np.testing.assert_array_equal(
        count["forward_bytes"], 50 * data + count["repairs"] * sample + count["repair_packets"] * packet
    )
    assert data == 28 + 20 + 12 + 24 + 100 + 32  # IP and UDP, RTPS, INFO_TS, DATA, payload, HEARTBEAT
    quiet = sent(IndependentLoss(0.1), **BEST_EFFORT).uplink
    assert all(quiet[kind].sum() == 0 for kind in ("repairs", "heartbeats", "acknacks", "backward_bytes"))


def test_compute_and_directions_add_up() -> None:
    net = DdsNetwork(
        uplink=Topic(Constant(0.02)), compute=TruncatedNormal(0.05, 0.01), downlink=Topic(Constant(0.03)), name="sum"
    )
    loops = jax.jit(lambda key: net.loops(key, 200, 2, 0.2))(jax.random.key(3))
    np.testing.assert_allclose(loops.loop_time, 0.05 + loops.ended - loops.uplink, atol=1e-12)


def test_it_is_a_network_like_others() -> None:
    topic = Topic(TruncatedNormal(0.01, 0.003), IndependentLoss(0.1), Profile("best_effort", depth=5))
    net = DdsNetwork(uplink=topic, downlink=topic)
    assert isinstance(net, Network) and hash(net) == hash(replace(net)) and net == replace(net)
    keys = jax.random.split(jax.random.key(42), 3)
    together = loop_times(net, keys, 60, 2, 0.02)
    assert together.shape == (3, 60, 2) and together.dtype == jnp.result_type(float)
    # Two equal directions of mean 10 ms: half of what arrives does so within 20 ms.
    np.testing.assert_allclose(net.reliability([[0.02], [1.0]], Load(60, 2, 0.02)).share, [[0.405], [0.81]], atol=0.01)
    description = json.loads(json.dumps(net.describe(), allow_nan=False))
    assert description["uplink"]["profile"]["depth"] == 5 and description["uplink"]["loss"]["probability"] == 0.1


def test_float32_does_the_same() -> None:
    """On common draws, cast: no loop differs but by rounding, save a few where the order of two events turns over."""
    topic = Topic(MILD, IndependentLoss(0.1))
    draws, other = draw_topics((topic, topic), jax.random.key(1), TICKS, 1, 0.02)
    run = jax.jit(lambda write, draws, back: carry(write, draws, back, topic)[0])
    one, back = (jax.tree.map(lambda a: a[0], each) for each in (draws, other.link))
    wide = np.asarray(run(jnp.arange(TICKS) * 0.02, one, back))
    narrow = run(*jax.tree.map(lambda a: a.astype(jnp.float32), (jnp.arange(TICKS) * 0.02, one, back)))
    assert narrow.dtype == jnp.float32
    assert np.isclose(wide, np.asarray(narrow), atol=2e-5).mean() > 0.97


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Profile("reliably"), r"Profile.reliability: got 'reliably', expected one of best_effort, reliable"),
        (lambda: Profile(depth=0), r"Profile.depth: got 0, expected at least 1"),
        (lambda: Profile(reader_depth=1.5), r"Profile.reader_depth: got 1.5"),  # type: ignore[arg-type]
        (lambda: Profile(heartbeat_period=0.0), r"Profile.heartbeat_period: got 0.0, expected > 0"),
        (lambda: Profile(lifespan=-1.0), r"Profile.lifespan: got -1.0"),
        (lambda: Profile(lifespan_from="sender"), r"Profile.lifespan_from: got 'sender'"),
        (lambda: Profile(piggyback="some"), r"Profile.piggyback: got 'some', expected one of always, full, never"),
        (lambda: Topic(payload=0), r"Topic.payload: got 0"),
        (lambda: Topic(profile="x"), r"Topic.profile: got 'x', expected a Profile"),  # type: ignore[arg-type]
        (lambda: DdsNetwork(uplink=Constant(0.1)), r"DdsNetwork.uplink: got Constant"),  # type: ignore[arg-type]
    ],
)
def test_bad_arguments_are_named(make: Any, message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        make()
