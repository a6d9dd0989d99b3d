"""Tables of stamps: clocks against known offsets, each kind of dirt against its count, and back into a network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd
import pytest

from qocjax.advice.character import quantiles
from qocjax.network import Load, Trace, read_trace
from qocjax.recorded import ClockRules, LoopTrace, Rules, RunFiles, StampsFormat, TopicPatterns, read_run
from qocjax.recorded.clocks import lower_envelope, steps, two_way_clock
from qocjax.recorded.run import RecordedRun
from qocjax.recorded.tables import percentile

NONE = TopicPatterns((), ())
PERIOD, LOOPS, EPOCH = 0.05, 4000, 1.7e9
COLUMNS = ["sequence", "uplink_send", "edge_receive", "edge_send", "downlink_receive"]


def truth(seed: int = 0, loops: int = LOOPS, smallest: tuple[float, float] = (2e-3, 2e-3)) -> dict[str, np.ndarray]:
    """True delays (s): gamma-distributed above their smallest."""
    rng = np.random.default_rng(seed)
    return {
        "send": PERIOD * np.arange(loops),
        "uplink": smallest[0] + rng.gamma(2.0, 1.5e-3, loops),
        "compute": rng.normal(0.03, 0.002, loops),
        "downlink": smallest[1] + rng.gamma(2.0, 1.5e-3, loops),
    }


def stamps(true: dict[str, np.ndarray], offset: np.ndarray | float = 0.0) -> pd.DataFrame:
    """The table that a robot and an edge whose clock is `offset` ahead would write."""
    receive = true["send"] + true["uplink"]
    reply = receive + true["compute"]
    return pd.DataFrame({
        "sequence": np.arange(true["send"].size), "uplink_send": EPOCH + true["send"],
        "edge_receive": EPOCH + receive + offset, "edge_send": EPOCH + reply + offset,
        "downlink_receive": EPOCH + reply + true["downlink"],
    })  # fmt: skip


def ingest(table: pd.DataFrame, folder: Path, layout: StampsFormat | None = None, **clock: Any) -> RecordedRun:
    path = folder / "loops.csv"
    table.to_csv(path, index=False, float_format="%.7f")
    rules = Rules(NONE, layout or StampsFormat(), ClockRules(**clock))
    return read_run(RunFiles("run", stamps=((path, None),)), rules, quiet=True)


def trace_of(run: RecordedRun) -> LoopTrace:
    (trace,) = run.loops.values()
    return trace


def found(run: RecordedRun) -> dict[str, int]:
    return {each.cause: each.count for each in run.findings}


@pytest.mark.parametrize("drift", [0.0, 5e-6, -2e-4])
def test_offset_and_drift_are_recovered(drift: float) -> None:
    true = truth()
    offset = 3.7 + drift * true["send"]
    clock = two_way_clock(true["send"], true["uplink"] + offset, true["downlink"] - offset, 20.0)
    assert np.abs(clock.offset(true["send"]) - offset).max() < 4e-4
    assert clock.drift == pytest.approx(drift, abs=2e-6)
    assert 2e-3 < clock.uncertainty < 2.5e-3  # half of both smallest delays together


def test_uneven_smallest_delays_stay_within_the_uncertainty() -> None:
    true = truth(smallest=(6e-3, 1e-3))
    clock = two_way_clock(true["send"], true["uplink"] + 1.0, true["downlink"] - 1.0, 20.0)
    error = np.abs(clock.offset(true["send"]) - 1.0)
    assert (error > 2e-3).all() and (error < clock.uncertainty).all()


def test_envelope_ignores_single_wrong_delays() -> None:
    true = truth()
    delay = true["uplink"].copy()
    delay[1234] = -0.5
    knots, envelope, drift = lower_envelope(true["send"], delay, 10.0)
    assert np.abs(np.interp(true["send"], knots, envelope) - 2e-3).max() < 5e-4
    assert abs(drift) < 2e-6


@pytest.mark.parametrize(("time", "delay", "window", "message"), [
    ([], [], 1.0, "got 0 delays"), ([0.0], [np.nan], 1.0, "expected finite"), ([0.0], [1.0], 0.0, "window: got 0.0"),
])  # fmt: skip
def test_bad_envelopes_are_refused(time: list, delay: list, window: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        lower_envelope(np.array(time), np.array(delay), window)


def test_steps_of_a_clock_are_told_from_slow_stretches() -> None:
    true = truth()
    offset = np.where(np.arange(LOOPS) < 1500, 0.0, 0.1)
    up, down = true["uplink"] + offset, true["downlink"] - offset
    assert steps(up, down, 0.02).tolist() == [1500]
    slow = np.where((np.arange(LOOPS) > 1000) & (np.arange(LOOPS) < 2000), 0.2, 0.0)
    assert steps(true["uplink"] + slow, true["downlink"], 0.02).size == 0
    assert steps(up[:30], down[:30], 0.02).size == 0


def test_parts_of_a_loop_are_recovered(tmp_path: Path) -> None:
    true = truth()
    run = ingest(stamps(true, 12.0 + 2e-5 * true["send"]), tmp_path)
    table = trace_of(run).table
    assert found(run) == {}
    assert np.abs(table["uplink"] - true["uplink"]).max() < 5e-4
    assert np.abs(table["downlink"] - true["downlink"]).max() < 5e-4
    np.testing.assert_allclose(table["compute"], true["compute"], atol=1e-6)
    np.testing.assert_allclose(
        table["loop_time"], sum(true[part] for part in ("uplink", "compute", "downlink")), atol=1e-6
    )
    np.testing.assert_allclose(table["source_stamp"], true["send"], atol=1e-6)
    assert trace_of(run).epoch == pytest.approx(EPOCH, abs=1e-5)


def test_stamps_of_one_clock_are_taken_as_they_are(tmp_path: Path) -> None:
    true = truth(smallest=(6e-3, 1e-3))
    table = trace_of(ingest(stamps(true), tmp_path, same=True)).table
    np.testing.assert_allclose(table["uplink"], true["uplink"], atol=1e-6)


def test_a_step_of_the_clock_is_found_and_taken_out(tmp_path: Path) -> None:
    true = truth()
    run = ingest(stamps(true, np.where(np.arange(LOOPS) < 2500, 0.3, -0.4)), tmp_path)
    assert found(run) == {"clock_steps": 1}
    assert np.abs(trace_of(run).table["uplink"] - true["uplink"]).max() < 5e-4


def test_offset_that_cannot_be_known_leaves_what_needs_it_out(tmp_path: Path) -> None:
    true = truth(smallest=(0.03, 0.03))
    run = ingest(stamps(true, 5.0), tmp_path)
    table = trace_of(run).table
    assert found(run) == {"clock_unknown": 1}
    assert table[["uplink", "downlink"]].isna().all(axis=None)
    assert np.isfinite(table[["compute", "loop_time"]]).all(axis=None)


def test_lost_loops_and_where(tmp_path: Path) -> None:
    table = stamps(truth())
    table.loc[100:109, ["edge_receive", "edge_send", "downlink_receive"]] = np.nan
    table.loc[200:204, "downlink_receive"] = np.nan
    run = ingest(table, tmp_path)
    trace = trace_of(run)
    assert trace.table["lost"].sum() == 15 and np.isinf(trace.table["loop_time"]).sum() == 15
    assert trace.lost_uplink == 10
    assert trace.table["uplink"].notna().sum() == LOOPS - 10  # the uplink of a loop whose answer was lost is known


DIRT = {
    "duplicates": (lambda t: pd.concat([t, t.iloc[50:57]]), 7),
    "unordered": (lambda t: t.iloc[[*range(100), 101, 100, *range(102, 500), 501, 500, *range(502, LOOPS)]], 2),
    "restarts": (lambda t: t.assign(sequence=np.where(t.index < 3000, t["sequence"], t["sequence"] - 3000)), 1),
    "missing_numbers": (lambda t: t.drop(index=[70, 71, 900]), 3),
    "gaps": (lambda t: t.assign(**{name: t[name] + np.where(t.index >= 2000, 3.0, 0.0) for name in COLUMNS[1:]}), 1),
    "negative_loop_time": (lambda t: t.assign(downlink_receive=t["downlink_receive"] - 1.0 * (t.index == 9)), 1),
    "negative_compute": (lambda t: t.assign(edge_send=t["edge_send"] - np.where(t.index % 1000 == 9, 0.5, 0.0)), 4),
    "negative_network": (lambda t: t.assign(edge_send=t["edge_send"] + np.where(t.index % 1000 == 9, 0.5, 0.0)), 4),
    "negative_leg": (lambda t: t.assign(
        edge_receive=t["edge_receive"] - np.where(t.index == 9, 0.02, 0.0),
        edge_send=t["edge_send"] - np.where(t.index == 9, 0.02, 0.0),
    ), 1),
    "no_source_stamp": (lambda t: t.assign(uplink_send=t["uplink_send"].where(t.index % 2000 != 5)), 2),
    "stamps_back": (lambda t: t.assign(**{n: t[n] - np.where(t.index >= 2000, 1.0, 0.0) for n in COLUMNS[1:]}), 1),
}  # fmt: skip


@pytest.mark.parametrize("cause", DIRT)
def test_each_kind_of_dirt_is_counted(cause: str, tmp_path: Path) -> None:
    spoil, count = DIRT[cause]
    counts = found(ingest(spoil(stamps(truth())), tmp_path))
    assert counts.pop(cause) == count
    allowed = {"no_source_stamp": {"missing_numbers"}, "duplicates": {"unordered"}}
    assert set(counts) <= allowed.get(cause, set())


def test_dirt_leaves_the_rest_as_it_was(tmp_path: Path) -> None:
    clean = trace_of(ingest(stamps(truth()), tmp_path)).table
    dirty = DIRT["duplicates"][0](DIRT["unordered"][0](stamps(truth())))
    pd.testing.assert_frame_equal(trace_of(ingest(dirty, tmp_path)).table, clean)


def test_numbers_go_on_after_a_restart(tmp_path: Path) -> None:
    trace = trace_of(ingest(DIRT["restarts"][0](stamps(truth())), tmp_path))
    assert trace.table["sequence"].tolist() == list(range(LOOPS))
    assert trace.table["number"].iloc[3000] == 0 and trace.table["session"].nunique() == 2


def test_missing_numbers_become_lost_loops_where_wanted(tmp_path: Path) -> None:
    table = stamps(truth()).drop(index=[70, 71, 900])
    trace = trace_of(ingest(table, tmp_path, missing_are_lost=True))
    assert trace.table["sequence"].tolist() == list(range(LOOPS))
    assert trace.table.index[trace.table["lost"]].tolist() == [70, 71, 900]
    assert trace.table["source_stamp"][70] == pytest.approx(70 * PERIOD, abs=1e-6)


def test_sessions_have_clocks_of_their_own(tmp_path: Path) -> None:
    true = truth()
    table = stamps(true, np.where(np.arange(LOOPS) < 2000, 7.0, -3.0))
    table["part"] = np.where(table.index < 2000, "a", "b")
    run = ingest(table, tmp_path, StampsFormat(session="part"))
    assert found(run) == {} and len(trace_of(run).clocks) == 2
    assert np.abs(trace_of(run).table["downlink"] - true["downlink"]).max() < 5e-4


def test_robots_of_one_table_get_a_trace_each(tmp_path: Path) -> None:
    one, two = stamps(truth(1, 300)).assign(who="r1"), stamps(truth(2, 200)).assign(who="r2")
    run = ingest(pd.concat([one, two]), tmp_path, StampsFormat(robot="who"))
    assert {name: len(trace.table) for name, trace in run.loops.items()} == {"r1": 300, "r2": 200}


def test_trace_goes_back_into_a_network(tmp_path: Path) -> None:
    table = stamps(truth())
    table.loc[table.index % 50 == 3, "downlink_receive"] = np.nan
    trace = trace_of(ingest(table, tmp_path))
    path = tmp_path / "trace.csv"
    trace.table.to_csv(path, index=False, float_format="%.9g")
    network = read_trace(path, "loop_time", "s", sequence="sequence", gaps_are_lost=True)
    np.testing.assert_allclose(network.delays, trace.table["loop_time"], rtol=1e-8)
    assert network.reliability(np.inf).share == pytest.approx(0.98)
    assert network.draw(jax.random.key(0), 10, 2, PERIOD).shape == (10, 2)


def test_parquet_and_json_say_the_same_as_csv(tmp_path: Path) -> None:
    table = stamps(truth(loops=400))
    expected = trace_of(ingest(table, tmp_path)).table
    ns = pd.DataFrame({name: (table[name] - EPOCH).mul(1e9).round().astype("int64") for name in COLUMNS[1:]})
    ns += int(EPOCH) * 10**9
    ns.insert(0, "sequence", table["sequence"])
    ns.to_parquet(tmp_path / "loops.parquet")
    (tmp_path / "loops.json").write_text(json.dumps({"log": {"rows": ns.to_dict("records")}}))
    for name, records in (("loops.parquet", None), ("loops.json", "log.rows")):
        rules = Rules(NONE, StampsFormat(unit="ns", records=records))
        run = read_run(RunFiles("run", stamps=((tmp_path / name, None),)), rules, quiet=True)
        pd.testing.assert_frame_equal(trace_of(run).table, expected, atol=2e-6)


def test_stamps_of_the_edge_are_joined_by_number(tmp_path: Path) -> None:
    table = stamps(truth(loops=400), 2.0)
    expected = trace_of(ingest(table, tmp_path)).table
    robot, edge = tmp_path / "robot.csv", tmp_path / "edge.csv"
    table[["sequence", "uplink_send", "downlink_receive"]].to_csv(robot, index=False, float_format="%.7f")
    far = table[["sequence", "edge_receive", "edge_send"]].set_axis(["n", "in", "out"], axis=1)
    pd.concat([far.sample(frac=1.0, random_state=0), far.iloc[:3]]).to_csv(edge, index=False, float_format="%.7f")
    layout = StampsFormat(edge_files="edge.csv", edge_columns=("n", "in", "out"))
    run = read_run(RunFiles("run", stamps=((robot, edge),)), Rules(NONE, layout), quiet=True)
    assert found(run) == {"duplicates": 3}
    pd.testing.assert_frame_equal(trace_of(run).table, expected)


BAD = {
    "text": ("sequence,uplink_send,edge_receive,edge_send,downlink_receive\n0,soon,1,1,1\n",
             r"loops.csv, line 2, column 'uplink_send': got 'soon', expected a number"),
    "column": ("sequence,sent\n0,1\n", r"loops.csv: has no column 'uplink_send'; its columns are 'sequence', 'sent'"),
    "all lost": ("sequence,uplink_send,edge_receive,edge_send,downlink_receive\n0,1,,,\n", "all 1 loops are lost"),
    "nothing": ("sequence,uplink_send,edge_receive,edge_send,downlink_receive\n0,,,,\n", "holds no loop"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_tables_are_one_clear_line(case: str, tmp_path: Path) -> None:
    text, message = BAD[case]
    (tmp_path / "loops.csv").write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_run(RunFiles("run", stamps=((tmp_path / "loops.csv", None),)), Rules(NONE), quiet=True)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("content", "records", "message"), [
    ("{", None, "line 1: is no JSON"), ('{"a": 1}', "b", "has no 'b' of stamps.records=b"),
    ('[{"sequence": 0}]', None, "has no column 'uplink_send'"), ("[]", None, "expected a list of records"),
])  # fmt: skip
def test_bad_json_is_one_clear_line(content: str, records: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=message):
        read_run(RunFiles("run", stamps=((path, None),)), Rules(NONE, StampsFormat(records=records)), quiet=True)


def _rows(loops: int = 50) -> pd.DataFrame:
    send = EPOCH + 0.05 * np.arange(loops)
    return pd.DataFrame({"sequence": np.arange(loops), "uplink_send": send, "edge_receive": send + 0.005,
                         "edge_send": send + 0.007, "downlink_receive": send + 0.012})  # fmt: skip


def _times(table: pd.DataFrame) -> pd.DataFrame:
    stamps = {name: pd.to_datetime((table[name] * 1e6).round().astype("int64"), unit="us") for name in COLUMNS[1:]}
    return table.assign(**stamps)


def _scaled(table: pd.DataFrame, factor: float) -> pd.DataFrame:
    """Whole numbers of a smaller unit."""
    whole = {name: (table[name] * 1e6).round().astype("int64") * int(factor // 1e6) for name in COLUMNS[1:]}
    return table.assign(**whole)


def _named(table: pd.DataFrame) -> pd.DataFrame:
    scaled = table.assign(**{name: table[name] * 1e3 for name in COLUMNS[1:]})
    return scaled.rename(columns={name: f"{name}(ms)" for name in COLUMNS[1:]})


ISO = "%Y-%m-%dT%H:%M:%S.%fZ"
LINES: dict[str, Any] = {"orient": "records", "lines": True, "double_precision": 9}
WRITERS = {
    "timestamps": ("loops.csv", lambda t, path: _times(t).to_csv(path, index=False)),
    "timestamps with a T": ("loops.csv", lambda t, path: _times(t).to_csv(path, index=False, date_format=ISO)),
    "parquet with timestamps": ("loops.parquet", lambda t, path: _times(t).to_parquet(path)),
    "JSON lines": ("loops.jsonl", lambda t, path: t.to_json(path, **LINES)),
    "ns, packed": ("loops.csv.gz", lambda t, path: _scaled(t, 1e9).to_csv(path, index=False)),
    "ms in the names": ("loops.csv", lambda t, path: _named(t).to_csv(path, index=False)),
    "decimal comma": ("loops.csv", lambda t, path: t.to_csv(path, index=False, sep=";", decimal=",")),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_stamps_come_in_many_forms(kind: str, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    write(_rows(), tmp_path / name)
    run = read_run(RunFiles("run", stamps=((tmp_path / name, None),)), Rules(NONE), quiet=True)
    table = trace_of(run).table
    assert len(table) == 50 and not table["lost"].any() and found(run) == {}
    np.testing.assert_allclose(table["loop_time"], 0.012, atol=1e-6)
    np.testing.assert_allclose(table["compute"], 0.002, atol=1e-6)
    assert trace_of(run).epoch == pytest.approx(EPOCH, abs=1e-5)


def test_a_receive_stamp_of_0_is_a_lost_loop(tmp_path: Path) -> None:
    table = _rows(10)
    table.loc[[3, 4, 7], ["edge_receive", "edge_send", "downlink_receive"]] = 0
    run = ingest(table, tmp_path)
    assert trace_of(run).table.index[trace_of(run).table["lost"]].tolist() == [3, 4, 7]
    assert found(run) == {"zero_stamps": 3} and trace_of(run).lost_uplink == 3


def test_a_unit_that_the_stamps_contradict_is_refused_or_said(tmp_path: Path) -> None:
    path = tmp_path / "loops.csv"
    _rows().assign(uplink_send=1_700_000_000_000_000_000).to_csv(path, index=False)
    with pytest.raises(ValueError, match=r"stamps.unit: got 's' for column 'uplink_send' of .*, expected 'ns'"):
        read_run(RunFiles("run", stamps=((path, None),)), Rules(NONE, StampsFormat(unit="s")), quiet=True)
    small = _rows().assign(**{name: (_rows()[name] - EPOCH) / 2553 for name in COLUMNS[1:]})
    assert any("half of the loops take less than 4.7 us" in note for note in ingest(small, tmp_path).findings.notes)
    long = _rows().assign(downlink_receive=_rows()["downlink_receive"] + 3.0)
    assert any(
        "half of the loops take more than 3.012 s in a" in note for note in ingest(long, tmp_path).findings.notes
    )


def test_percentiles_are_those_of_advice(tmp_path: Path) -> None:
    loop = np.array([10.0, 20.0, 30.0, 263.0, 271.0, np.inf]) / 1e3
    quantile = quantiles(Trace(loop, "loops"), Load(100, 1, 0.05), [0.5 * 5 / 6, 0.8 * 5 / 6, 0.95 * 5 / 6])
    assert [percentile(loop[:5], level) for level in (50, 80, 95)] == pytest.approx(
        quantile.tolist(), rel=2e-6
    )  # a deadline's tolerance
