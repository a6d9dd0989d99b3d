"""Studies on one QoC scale."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf
from scipy import stats

from qocjax import QocScale, Study, open_study, qoc
from qocjax.commands.compare import comparison_text, run
from qocjax.commands.quoting import as_options
from qocjax.commands.sweep import run as run_sweep
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.config.compare import CompareConfig
from qocjax.figures.compared import compared
from qocjax.statistics.estimates import unpaired
from qocjax.store import write_config
from qocjax.study.comparison import compare
from qocjax.study.opened import open_sweep

SMALL = [
    "sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[100,200,800]", "sweep.seeds=4",
    "sweep.evaluation_seeds=6", "scenario.horizon=2", "loop.tau=0.05", "figures=false", "report=false",
]  # fmt: skip
STUDIES = {
    "held": [],
    "stopped": ["loop.actuation=arrival"],
    "other key": ["key=1"],
    "fewer": ["sweep.evaluation_seeds=4"],
    "both": ["+sweep.grids.eta=[0,0.6]"],
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of studies that differ in something."""
    home = tmp_path_factory.mktemp("studies")
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        for name, options in STUDIES.items():
            config = load(StudyConfig, compose("sweep", [*SMALL, *options]))
            run_sweep(config, home / name, quiet=True)
    return {name: home / name for name in STUDIES}


@pytest.fixture(scope="module")
def studies(folders: dict[str, Path]) -> dict[str, Study]:
    return {name: open_sweep(folder) for name, folder in folders.items()}


def pick(studies: dict[str, Study], *names: str) -> dict[str, Study]:
    return {name: studies[name] for name in names}


def with_scenario(study: Study, **changed: object) -> Study:
    """The study as if it had been another scenario's."""
    options = copy.deepcopy(dict(study.configuration or {}))
    options["scenario"].update(changed)
    return replace(study, configuration=options)


def by_hand(study: Study, policy: str, scale: QocScale) -> np.ndarray:
    """QoC of a policy's choice in the sweep of kappa by evaluation seed."""
    row = study.policies.query("sweep == 'kappa' and policy == @policy").iloc[0]
    runs = study.evaluation
    at = np.isclose(runs["kappa"], row["value"]) & np.isclose(runs["deadline"], row["deadline"])
    (place,) = np.flatnonzero(at & np.isclose(runs["eta"], 0.6))
    return np.asarray(qoc(runs["auc"].values[place].astype(float), scale)).mean(axis=-1)


def row_of(table: pd.DataFrame, study: str, policy: str) -> pd.Series:
    return table.query("study == @study and sweep == 'kappa' and policy == @policy").iloc[0]


def test_the_scale_is_that_of_all_runs(studies: dict[str, Study]) -> None:
    names = ("held", "stopped", "other key")
    auc = np.concatenate([studies[name].runs["auc"].values.ravel() for name in names])
    largest = max(studies[name].scale.largest for name in names)
    scale = compare(pick(studies, *names)).scale
    assert (scale.median, scale.largest) == (QocScale.of(auc).median, largest) and scale.median_se > 0


def test_scores_and_paired_differences_are_those_by_hand(studies: dict[str, Study]) -> None:
    found = compare(pick(studies, "held", "stopped"))
    assert found.notes == []
    for policy in ("Co-design", "MinDelay", "MaxRel"):
        here, there = (by_hand(studies[name], policy, found.scale) for name in ("stopped", "held"))
        row = row_of(found.table, "stopped", policy)
        assert row["paired"] and row["seeds"] == 6
        assert row["qoc"] == pytest.approx(here.mean(), rel=1e-12)
        assert row["difference"] == pytest.approx((here - there).mean(), abs=1e-12)
        interval = stats.ttest_rel(here, there).confidence_interval() if np.any(here != there) else (0.0, 0.0)
        assert (row["difference_low"], row["difference_high"]) == pytest.approx(tuple(interval), abs=1e-9)
        first = row_of(found.table, "held", policy)
        assert np.isnan(first["difference"]) and not first["paired"]
    own = studies["stopped"].policies
    rows = found.table.query("study == 'stopped'")
    np.testing.assert_array_equal(rows[["value", "deadline"]], own[["value", "deadline"]])
    np.testing.assert_array_equal(rows["qoc_own_scale"], own["qoc"])


def test_a_study_beside_itself_differs_by_nothing(studies: dict[str, Study]) -> None:
    found = compare({"a": studies["held"], "b": studies["held"]})
    gaps = found.table.query("study == 'b'")[["difference", "difference_low", "difference_high"]]
    assert (gaps.to_numpy() == 0).all()
    np.testing.assert_allclose(found.table["qoc"], found.table["qoc_own_scale"], rtol=1e-12)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (None, "key 0 and 1"),
        ({"start_jitter": [0.2, 0.1]}, "scenario.start_jitter [0.1, 0.1] and [0.2, 0.1]"),
        ({"map": "hall.yaml"}, "scenario.map null and hall.yaml"),
    ],
)
def test_other_random_numbers_are_not_paired(studies: dict[str, Study], changed: dict | None, why: str) -> None:
    other = studies["other key"] if changed is None else with_scenario(studies["stopped"], **changed)
    found = compare({"held": studies["held"], "other": other})
    assert found.notes == [f"other is not paired with held: {why}."]
    here, there = (by_hand(each, "Co-design", found.scale) for each in (other, studies["held"]))
    row = row_of(found.table, "other", "Co-design")
    assert not row["paired"]
    interval = stats.ttest_ind(here, there, equal_var=False).confidence_interval()
    assert (row["difference_low"], row["difference_high"]) == pytest.approx(tuple(interval), rel=1e-6, abs=1e-9)


def test_pairs_are_the_common_seeds(studies: dict[str, Study]) -> None:
    found = compare(pick(studies, "held", "fewer"))
    assert found.notes == ["fewer is paired with held on the 4 evaluation seeds that both have."]
    here, there = (by_hand(studies[each], "MaxRel", found.scale) for each in ("fewer", "held"))
    row = row_of(found.table, "fewer", "MaxRel")
    assert row["paired"] and row["difference"] == pytest.approx((here - there[:4]).mean(), abs=1e-12)


def test_a_sweep_that_only_one_has_is_told(studies: dict[str, Study]) -> None:
    found = compare(pick(studies, "held", "both"))
    assert found.notes == ["held has no sweep of eta, which both has."]
    gaps = found.table.query("study == 'both'").set_index("sweep")["difference"]
    assert gaps["eta"].isna().all() and gaps["kappa"].notna().all()


def test_curves_are_the_best_value_at_each_deadline(studies: dict[str, Study]) -> None:
    """On a study's own scale they are the best of its table."""
    found = compare({"a": studies["held"], "b": studies["held"]})
    best = studies["held"].results.groupby("deadline")["qoc"].max()
    curve = found.curves.query("study == 'a'").set_index("deadline")["qoc"]
    np.testing.assert_allclose(curve[best.index], best, rtol=1e-12)


def test_what_found_no_design_is_left_out(studies: dict[str, Study]) -> None:
    policies = studies["held"].policies.copy()
    policies.loc[policies["policy"] == "MinDelay", ["value", "deadline", "qoc", "auc"]] = np.nan
    found = compare({"a": studies["stopped"], "b": replace(studies["held"], policies=policies)})
    assert set(found.table.query("study == 'b'")["policy"]) == {"Co-design", "MaxRel"}
    assert found.table["qoc"].notna().all()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"horizon": 2.5}, r"scenario\.horizon 2\.0 in held and 2\.5 in other, expected the same"),
        ({"reference": {"kind": "uncapped"}}, r"scenario\.reference \{kind: nominal.*\} in held and \{kind: uncapped"),
        (
            {"normaliser": "goal_distance"},
            r"scenario\.normaliser initial_disagreement in held and goal_distance in other",
        ),
        ({"weights": [1.0, 2.0]}, r"scenario\.weights \[1\.0, 1\.0\] in held and \[1\.0, 2\.0\] in other"),
    ],
)
def test_auc_that_cannot_be_compared_is_refused(studies: dict[str, Study], changed: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        compare({"held": studies["held"], "other": with_scenario(studies["held"], **changed)})


def test_one_study_and_one_of_unknown_origin_are_refused(studies: dict[str, Study]) -> None:
    with pytest.raises(ValueError, match="got 1, expected at least two"):
        compare(pick(studies, "held"))
    with pytest.raises(ValueError, match="got b without its configuration"):
        compare({"a": studies["held"], "b": replace(studies["held"], configuration=None)})


def config(paths: list[Path], **changed: object) -> CompareConfig:
    values = {"studies": [str(path) for path in paths], "names": None, "figures": True, "report": True}
    return CompareConfig.model_validate(values | changed)


def test_files_are_written_and_agree(folders: dict[str, Path], tmp_path: Path) -> None:
    hostile = "</script><script>alert(1)</script>"
    names = ["held", hostile]
    found = run(config([folders["held"], folders["other key"]], names=names), tmp_path)
    table = pd.read_csv(tmp_path / "comparison.csv")
    np.testing.assert_allclose(table["qoc"], found.table["qoc"], rtol=1e-8)
    assert list(dict.fromkeys(table["study"])) == names
    record = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    assert (record["j_med"], record["j_max"]) == (found.scale.median, found.scale.largest)
    assert record["studies"]["held"] == str(folders["held"].resolve())
    assert (tmp_path / "figures" / "comparison.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert hostile not in page and "alert(1)" in page
    assert len(page) < 5e6
    assert "unpaired" in comparison_text(found.table)


def test_names_are_ends_of_paths_that_differ(tmp_path: Path) -> None:
    paths = [tmp_path / "monday" / "0", tmp_path / "tuesday" / "0"]
    assert list(config(paths).build()) == ["monday/0", "tuesday/0"]
    assert list(config([tmp_path / "a", tmp_path / "b"]).build()) == ["a", "b"]


@pytest.mark.parametrize(
    ("names", "changed", "message"),
    [
        (["a"], {}, "studies: got 1, expected at least two folders"),
        (["a", "b", "a"], {}, "twice, expected each study once"),
        (["a", "b"], {"names": ["one"]}, "expected 2 different names"),
        (["a", "b"], {"names": ["one", "one"]}, "expected 2 different names"),
    ],
)
def test_bad_lists_are_refused(tmp_path: Path, names: list[str], changed: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        config([tmp_path / name for name in names], **changed).build()


@pytest.mark.parametrize(
    "name", ["plain", "with blank", "a,b", 'quo"te', "o'clock", "back\\slash", 'a\\"b', "[x]", "key: v", "\\", "${x}"]
)
def test_folders_become_an_option_that_says_the_same(name: str) -> None:
    (option,) = as_options([name, "other"])
    assert OverridesParser.create().parse_override(option).value() is not None
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        assert list(compose("compare", [option]).studies) == [name, "other"]


def test_options_stay_as_they_are() -> None:
    given = ["studies=[a,b]", "--help", "figures=false"]
    assert as_options(given) == given
    assert as_options(["a", "figures=false", "b"]) == ["figures=false", 'studies=["a","b"]']


def test_command_line(folders: dict[str, Path], tmp_path: Path) -> None:
    where = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1]), "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-m", "qocjax.compare"]
    options = {"cwd": tmp_path, "env": where, "capture_output": True, "encoding": "utf-8"}
    done = subprocess.run([*command, str(folders["held"]), str(folders["stopped"]), "figures=false"], **options)
    assert done.returncode == 0, done.stderr
    (results,) = (tmp_path / "results" / "compare").iterdir()
    assert {path.name for path in results.iterdir()} >= {"comparison.csv", "curves.csv", "report.html", "config.yaml"}
    assert "difference to held [95 %]" in done.stdout
    done = subprocess.run([*command, str(folders["held"]), "nowhere"], **options)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: nowhere: got no record.json there")


@pytest.mark.parametrize(
    "command", ["tune", "codesign", "fleet", "advise", "validate", "show", "qos", "compare", "ingest"]
)
def test_the_folder_of_another_command_is_called_what_it_is(command: str, tmp_path: Path) -> None:
    needed = {"compare": ["studies=[a,b]"], "ingest": ["path=runs"]}.get(command, [])
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = OmegaConf.to_container(compose(command, needed), resolve=True)
    write_config(tmp_path, config)
    (tmp_path / "record.json").write_text("{}")
    with pytest.raises(ValueError, match=rf"got what python -m qocjax\.{command} wrote, expected the folder"):
        open_sweep(tmp_path)


def test_the_folder_of_several_runs_is_called_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "multirun.yaml").write_text("")
    with pytest.raises(ValueError, match="got several runs, each in a folder of its own inside"):
        open_study(tmp_path)


def test_figure_is_drawn_for_many_studies_and_hostile_names(studies: dict[str, Study]) -> None:
    found = compare({f"${k}_{{$ and a name that is much too long": studies["held"] for k in range(7)})
    figure = compared(found.table)
    figure.draw_without_rendering()
    assert len(figure.axes) == 6
    with pytest.raises(ValueError, match="column 'qoc_low' is missing"):
        compared(found.table.drop(columns="qoc_low"))


def test_welch_interval_of_equal_constants_is_a_point() -> None:
    gap = unpaired([0.5, 0.5, 0.5], [0.25, 0.25])
    assert (gap.mean, gap.low, gap.high) == (0.25, 0.25, 0.25)
