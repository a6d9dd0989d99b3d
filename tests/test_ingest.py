"""The command that reads recorded runs: folders and labels, what is written, errors, and the measured data."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd
import pytest
from bags import AMCL, STAMPED, TWIST, Message, pose, speeds, stamped, write_bag
from hydra import compose, initialize_config_dir

import qocjax
from qocjax.commands import recordings
from qocjax.commands.ingest import Ingested, report, run
from qocjax.config import conf_dir, load
from qocjax.config.ingest import IngestConfig
from qocjax.figures.recorded import clock_figure, delay_figure
from qocjax.quality import QocScale, qoc
from qocjax.recorded import Labels
from qocjax.recorded.patterns import filled, matched, words

ROOT = Path(__file__).parents[1]


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


def ingest(path: Path, *options: str, folder: Path | None = None) -> Ingested:
    return run(load(IngestConfig, compose("ingest", [f"path='{path}'", *options])), folder, quiet=True)


def short_run(speed: float, delay: float = 0.1) -> list[Message]:
    """Two robots that drive side by side to x = 2 m, with commands that bear the stamp of a pose."""
    messages: list[Message] = []
    for k in range(150):
        time = 0.04 * k
        x = min(speed * time, 2.0)
        for robot, y in (("a", 0.5), ("b", -0.5)):
            messages.append((time, f"/{robot}/amcl_pose", AMCL, pose(AMCL, time, x, y, 0.0)))
            messages.append((time + delay, f"/{robot}/cmd_vel", STAMPED, stamped(time, speed, 0.0)))
    return sorted(messages, key=lambda message: message[0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of two QoS profiles and two delays, one of them cut off beyond use."""
    root = tmp_path_factory.mktemp("runs")
    for profile, reliability in (("best_effort", "BEST_EFFORT"), ("reliable", "RELIABLE")):
        for delay in (100, 300):
            for repeat in (1, 2):
                path = root / profile / f"delay_{delay}_{repeat}"
                path.parent.mkdir(exist_ok=True)
                storage = "mcap" if repeat == 1 else "sqlite3"
                write_bag(path, short_run(0.7 - delay / 1e3 + 0.05 * repeat, delay / 1e3), storage, reliability)
    (root / "reliable" / "delay_100_3.db3").write_bytes(b"nothing")
    (root / "reliable" / "delay_100_3").mkdir()
    (root / "reliable" / "delay_100_3.db3").rename(root / "reliable" / "delay_100_3" / "bag.db3")
    return root


def stamps(count: int = 100) -> pd.DataFrame:
    sent = 0.05 * np.arange(count)
    return pd.DataFrame({
        "sequence": np.arange(count), "uplink_send": sent, "edge_receive": sent + 0.01, "edge_send": sent + 0.03,
        "downlink_receive": sent + 0.045,
    })  # fmt: skip


def test_each_run_of_a_folder_is_judged_or_named(composer: None, tmp_path: Path) -> None:
    """Of what cannot be read, and of what would share a name, nothing goes without a word."""
    runs = tmp_path / "runs"
    (runs / "a b").mkdir(parents=True)
    good = stamps()
    for name in ("good.csv", "good.txt", "a b/one.csv", "utf16.csv"):
        good.to_csv(runs / name, index=False, encoding="utf-16" if name.startswith("utf16") else "utf-8")
    good.to_csv(runs / "a b__one.csv", index=False)
    packed = good.to_parquet(index=False)
    (runs / "cut.parquet").write_bytes(packed[: len(packed) // 2])
    text = good.to_json(orient="records")
    (runs / "cut.json").write_text(text[: len(text) // 2])
    (runs / "empty.csv").write_text("")
    good.rename(columns={"uplink_send": "sent"}).to_csv(runs / "wrong.csv", index=False)
    pd.DataFrame({"run": ["good"], "d_cfg_ms": [100]}).to_csv(runs / "labels.csv", index=False)  # no run
    result = ingest(runs, "figures=false", folder=tmp_path / "out")
    assert sorted(run.name for run in result.runs) == ["a b/one", "a b__one", "good.csv", "good.txt", "utf16"]
    assert {name: why.partition(": ")[0] != "" for name, why in result.failed.items()} == dict.fromkeys(
        ("cut.json", "cut.parquet", "empty", "wrong"), True
    )
    assert "has no column 'uplink_send'" in result.failed["wrong"] and "is empty" in result.failed["empty"]
    traces = sorted((tmp_path / "out" / "runs").rglob("trace_*.csv"))
    assert len(traces) == 5 and {len(pd.read_csv(path)) for path in traces} == {100}
    table = pd.read_csv(tmp_path / "out" / "summary.csv")
    assert sorted(table.loc[table["left_out"].notna(), "run"]) == sorted(result.failed)
    assert all(f"{name}: left out: " in report(result) for name in result.failed)


def test_one_recording_that_breaks_its_reader_takes_no_other_down(
    composer: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("one", "two", "three"):
        stamps().to_csv(tmp_path / f"{name}.csv", index=False)
    usual = recordings.read_run

    def broken(files: Any, *rest: Any, **more: Any) -> Any:
        if files.name == "two":
            raise RuntimeError("of a kind that nobody foresaw")
        return usual(files, *rest, **more)

    monkeypatch.setattr(recordings, "read_run", broken)
    result = ingest(tmp_path, "figures=false")
    assert [run.name for run in result.runs] == ["one", "three"]
    assert result.failed["two"].startswith("RuntimeError: of a kind that nobody foresaw (")


GROUPED = ["labels.pattern='{qos}/delay_{d_cfg_ms}_*'", "quality.goal=[2.0, 0.0]", "figures=false"]


def test_a_folder_of_runs_is_one_tidy_table(folder: Path, composer: None, tmp_path: Path) -> None:
    result = ingest(folder, *GROUPED, folder=tmp_path)
    table = pd.read_csv(tmp_path / "summary.csv")
    assert table["run"].iloc[-1] == "reliable/delay_100_3" and isinstance(table["left_out"].iloc[-1], str)
    table = table[table["left_out"].isna()]
    assert len(table) == 8 and list(result.failed) == ["reliable/delay_100_3"]
    assert "left out: " in report(result)
    assert set(table["qos"]) == {"best_effort", "reliable"} and set(table["d_cfg_ms"]) == {100.0, 300.0}
    np.testing.assert_allclose(table["loop_p50"], table["d_cfg_ms"] / 1e3, atol=1e-6)
    assert all(words.startswith(qos) for qos, words in zip(table["qos"], table["offered_qos"], strict=True))
    robots = pd.read_csv(tmp_path / "robots.csv")
    assert len(robots) == 16
    scale = QocScale.of(robots["auc"])
    np.testing.assert_allclose(robots["qoc"], qoc(robots["auc"].to_numpy(), scale), rtol=1e-6)
    np.testing.assert_allclose(table["qoc"], robots.groupby("run", sort=False)["qoc"].mean(), rtol=1e-6)
    groups = pd.read_csv(tmp_path / "groups.csv")
    assert len(groups) == 4 and (groups["runs"] == 2).all()
    pair = table[(table["qos"] == "reliable") & (table["d_cfg_ms"] == 300)]["auc"]
    row = groups[(groups["qos"] == "reliable") & (groups["d_cfg_ms"] == 300)].iloc[0]
    assert row["auc"] == pytest.approx(pair.mean(), rel=1e-6)
    half = 12.7062 * pair.std(ddof=1) / np.sqrt(2)  # Student's 97.5 % with one degree of freedom
    assert row["auc_high"] - row["auc"] == pytest.approx(half, rel=1e-4)


def test_labels_from_a_file(folder: Path, composer: None, tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text("run,d_cfg_ms,site\n*,100,hall\n*/delay_300_*,300,\nreliable/*,,yard\n")
    result = ingest(folder, f"labels.file={tmp_path / 'labels.csv'}", "figures=false")
    by_run = dict(zip((each.name for each in result.runs), result.labels, strict=True))
    assert by_run["best_effort/delay_100_1"] == {"d_cfg_ms": 100, "site": "hall"}
    assert by_run["reliable/delay_300_2"] == {"d_cfg_ms": 300, "site": "yard"}
    (tmp_path / "labels.csv").write_text("name,site\n*,hall\n")
    with pytest.raises(ValueError, match="has no column 'run'; its columns are 'name', 'site'"):
        Labels.of(None, tmp_path / "labels.csv")


def test_a_simulated_run_reads_back_as_itself(composer: None, tmp_path: Path) -> None:
    times = np.asarray(qocjax.paper_network().draw(jax.random.key(1), 1000, 2, 0.01))
    simulated = qocjax.simulate(qocjax.Scenario(horizon=10.0), qocjax.Design(deadline=0.25), times)
    simulated.to_pandas().to_csv(tmp_path / "poses.csv", index=False)
    result = ingest(tmp_path / "poses.csv", "quality.goal=[2.0, 0.0]", "figures=false")
    judged = result.runs[0].quality
    assert judged is not None
    np.testing.assert_allclose(judged.auc, simulated.auc, rtol=3e-4)
    assert judged.min_distance == pytest.approx(float(simulated.min_distance), rel=1e-6)
    assert [c.effort for c in result.runs[0].commands.values()] == pytest.approx(
        np.asarray(simulated.effort).tolist(), rel=0.02
    )


def test_a_run_may_be_a_table_of_poses_beside_tables_of_stamps(composer: None, tmp_path: Path) -> None:
    rows = [f"{0.1 * k},{robot},{0.05 * k},{y}" for k in range(50) for robot, y in (("a", 1), ("b", -1))]
    (tmp_path / "poses.csv").write_text("time,robot,x,y\n" + "\n".join(rows))
    stamps = "\n".join(f"{k},{0.1 * k},{0.1 * k + 0.03}" for k in range(50))
    (tmp_path / "loops.csv").write_text(f"sequence,uplink_send,downlink_receive\n{stamps}\n")
    result = ingest(tmp_path, "stamps.edge_receive=null", "stamps.edge_send=null", "figures=false")
    (only,) = result.runs
    assert only.quality is not None and len(only.loops["loops"].table) == 50
    result = ingest(tmp_path / "poses.csv", "topics.robots=[b]", "figures=false")
    assert result.summary["found_excluded"].tolist() == [50] and result.robots["robot"].tolist() == ["b"]


def test_command_line_writes_what_the_network_reads(folder: Path, tmp_path: Path) -> None:
    environment = os.environ | {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}

    def command(*options: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, "-m", *options]
        return subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)

    bag = folder / "reliable" / "delay_300_1"
    done = command("qocjax.ingest", f"path={bag}", "quality.goal=[2,0]", "hydra.run.dir=out")
    assert done.returncode == 0, done.stderr
    assert "a: 150 loops, 0 lost; ms at 50/95/99 %: loop time 300/300/300" in done.stdout
    place = tmp_path / "out" / "runs" / "delay_300_1"
    assert {path.name for path in place.glob("*.png")} == {"delays.png", "trajectories.png"}
    reliability = pd.read_csv(place / "reliability_a.csv").set_index("deadline")["reliability"]
    assert reliability[0.25] == 0.0 and reliability[0.3] == 1.0 and reliability[0.35] == 1.0
    done = command("qocjax.ingest", f"path={tmp_path / 'missing'}")
    assert done.returncode == 2
    assert done.stderr.strip() == (
        f"error: path: got {tmp_path / 'missing'}, which is not there, expected a bag, a table or a folder of them"
    )


BAD = {
    "unknown option": (["+clock.tick=1"], "clock.tick: got an unknown option"),
    "wrong type": (["clean.gap=wide"], "clean.gap: got 'wide', expected a valid number"),
    "negative window": (["clock.window=-1"], "clock.window: got -1.0, expected > 0"),
    "goal": (["quality.goal=[1]"], "quality.goal: got [1.0], expected 2 finite numbers"),
    "begin": (["quality.begin=soon"], "quality.begin: got 'soon', expected one of first, motion, command"),
    "word": (["topics.poses=['/{name}/odom']"], "expected no other word in braces than {robot}"),
    "label": (["labels.pattern=run"], "labels.pattern: got 'run', expected a word in braces"),
    "unit": (["stamps.unit=min"], "stamps.unit: got 'min', expected one of s, ms, us, ns"),
    "half a scale": (["quality.j_med=1.0"], "expected both or neither"),
    "half the edge": (["stamps.edge_send=null"], "got one without the other, expected both or neither"),
    "deadline": (["deadline_ms=[]"], "deadline_ms: got [], expected one or more finite numbers >= 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_one_clear_line(case: str, composer: None, tmp_path: Path) -> None:
    (tmp_path / "loops.csv").write_text("sequence,uplink_send,edge_receive,edge_send,downlink_receive\n0,1,2,3,4\n")
    options, message = BAD[case]
    with pytest.raises(ValueError) as error:
        ingest(tmp_path / "loops.csv", *options)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_nothing_to_read_is_an_error(composer: None, tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("nothing")
    with pytest.raises(ValueError, match=r"notes.md, expected a bag \(.db3, .mcap\) or a table"):
        ingest(tmp_path / "notes.md")
    with pytest.raises(ValueError, match="which holds no run, expected rosbag2 folders"):
        ingest(tmp_path)
    (tmp_path / "udpclient.plant.1.csv").write_text("seq,send_timestamp,recv_timestamp\n0,1,2\n")
    with pytest.raises(ValueError, match=r"0 files are its edge's .*, expected one"):
        ingest(tmp_path, "stamps=cleave", "stamps.files='udpclient.plant.{loop}.csv'")


def test_a_histogram_is_told_where_it_goes(composer: None, tmp_path: Path) -> None:
    (tmp_path / "up.xml").write_text("<histogram/>", encoding="utf-8")
    with pytest.raises(ValueError, match="is a law: network=loop delay@network.uplink.delay=histogram"):
        ingest(tmp_path / "up.xml")


def test_without_rosbags_a_bag_says_what_is_missing(
    folder: Path, composer: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "rosbags" else find(name, *rest)
    )
    with pytest.raises(
        ValueError, match=r"needs rosbags to be read, expected it installed: pip install 'qocjax\[ros\]'"
    ):
        ingest(folder / "reliable" / "delay_300_1")


@pytest.mark.parametrize(("pattern", "text", "expected"), [
    ("/{robot}/odom", "/a/odom", {"robot": "a"}), ("/{robot}/odom", "/a/b/odom", None), ("/odom", "/odom", {}),
    ("{qos}/delay_{ms}_*", "x/delay_20_7", {"qos": "x", "ms": "20"}), ("{a}_{a}", "1_1", {"a": "1"}),
    ("{a}_{a}", "1_2", None),
    ("a.b*", "a.bc", {}), ("a.b", "axb", None),
])  # fmt: skip
def test_patterns(pattern: str, text: str, expected: dict[str, str] | None) -> None:
    assert matched(pattern, text) == expected


def test_patterns_name_their_words() -> None:
    assert words("{qos}/{d_cfg_ms}_*") == ("qos", "d_cfg_ms")
    assert filled("service.{loop}.*", {"loop": "3"}) == "service.3.*"
    with pytest.raises(ValueError, match="expected names in braces"):
        words("{0}")


def test_figures_say_what_was_lost(composer: None, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    send = 0.05 * np.arange(400)
    up, down = 0.002 + rng.gamma(2.0, 1e-3, (2, 400))
    table = pd.DataFrame({"sequence": np.arange(400), "uplink_send": send, "edge_receive": send + up + 1.0,
                          "edge_send": send + up + 1.01, "downlink_receive": send + up + 0.01 + down})  # fmt: skip
    table.loc[::4, "downlink_receive"] = np.nan
    table.to_csv(tmp_path / "loops.csv", index=False)
    (trace,) = ingest(tmp_path / "loops.csv", "figures=false").runs[0].loops.values()
    loop, *_ = delay_figure({"a": trace}).axes[0].lines
    later = np.asarray(loop.get_ydata())  # a quarter is lost, and so takes longer than any time
    assert later[-1] == pytest.approx(0.25) and later[0] == pytest.approx(1 - 1 / 400) and (np.diff(later) < 0).all()
    assert loop.axes.get_yscale() == "log"
    offset = clock_figure(trace).axes[0].lines[2]
    np.testing.assert_allclose(offset.get_ydata(), 1000.0, atol=0.5)


def measured(name: str, shared_data: Path, *options: str) -> Ingested:
    if not (shared_data / name).is_dir():
        pytest.skip(f"no {name} among the measured data")
    return ingest(shared_data / name, "figures=false", *options)


def test_measured_loops(shared_data: Path, composer: None) -> None:
    result = measured("cleave-wifi-loop", shared_data, "stamps=cleave")
    first = result.summary.iloc[0]
    assert (first["loops"], first["lost"], first["lost_uplink"], first["found_unordered"]) == (23842, 9, 7, 4)
    assert first["clock_drift_ppm"] == pytest.approx(1.3, abs=0.3) and first["parts_share"] > 0.999


def test_measured_bags(shared_data: Path, composer: None) -> None:
    result = measured("turtlebot3-bags", shared_data, "robot=turtlebot3_burger")
    only = result.runs[0]
    assert only.commands["robot"].count == 666 and only.quality is not None
    assert set(only.qos.values()) == {"reliable keep_last(10)"}
    assert only.quality.path_length[0] == pytest.approx(4.7, abs=0.1)


def test_plain_twists_have_no_loop_time(composer: None, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [(0.1 * k, "/cmd_vel", TWIST, speeds(0.1, 0.0)) for k in range(20)])
    (only,) = ingest(bag, "figures=false").runs
    assert only.loops == {} and only.quality is None
    assert "robot" in only.commands


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("labels.pattern='{qos}/nothing_{d}'", "labels.pattern: got .* which fits none of the 1 runs, such as one"),
        ("labels.file=FILE", "labels.file: got runs 'other', which fit none of the 1 runs, such as one"),
        ("+quality.starts.ghost=[0,0,0]", "quality.starts: got ghost, expected one of the robots robot"),
    ],
)
def test_options_that_fit_no_run_are_refused(option: str, words: str, composer: None, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    stamps().assign(robot="robot").to_csv(tmp_path / "runs" / "one.csv", index=False)
    (tmp_path / "labels.csv").write_text("run,d_cfg_ms\nother,100\n")
    with pytest.raises(ValueError, match=words):
        ingest(tmp_path / "runs", "figures=false", "stamps.robot=robot",
               option.replace("FILE", str(tmp_path / "labels.csv")))  # fmt: skip
