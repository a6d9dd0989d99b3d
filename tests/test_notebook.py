"""How results show themselves in notebooks, and what of them is at hand there."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from qocjax import Design, Run, Scenario, Study, evaluate, one_at_a_time, open_study, paper_network, qoc, replay
from qocjax import run_study as study_of
from qocjax.config import conf_dir
from qocjax.store import write_config, write_json, write_table
from qocjax.study.results import Results

SHORT = Scenario(horizon=2.0)


@pytest.fixture(scope="module")
def study() -> Study:
    grid = one_at_a_time(Design(tau=0.05), {"kappa": [1.0, 2.0], "gamma": [2.0, 3.0]}, [0.1, 0.2, 0.4])
    return study_of(SHORT, grid, paper_network(), range(32), range(32, 64))


@pytest.fixture(scope="module")
def run() -> Run:
    return replay(SHORT, Design(deadline=0.2, tau=0.05), paper_network(), 3)


class Words(HTMLParser):
    """The text of a page, and its tags that nothing closes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.text, self.open = "", list[str]()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_study_shows_its_network_and_policies(study: Study) -> None:
    page = Words(study._repr_html_())
    assert page.open == []
    for word in ("kappa, gamma", "paper", "32 seeds, judged on 32 others", "Co-design", "MinDelay", "MaxRel"):
        assert word in page.text
    for row in study.policies.to_dict("records"):
        assert f"{row['qoc']:.4g}" in page.text and f"{row['qoc_low']:.4f} to {row['qoc_high']:.4f}" in page.text
    assert repr(study) == str(study) and "\n" not in repr(study) and len(repr(study)) < 200


def test_what_a_network_is_called_is_no_markup(study: Study) -> None:
    page = replace(study, network={"name": "<script>alert(1)</script>"})._repr_html_()
    assert "<script" not in page and "&lt;script&gt;" in page


def test_a_run_shows_its_metrics(run: Run) -> None:
    page = Words(run._repr_html_())
    assert page.open == []
    assert "200 ms" in page.text and f"{float(run.auc[1]):.4g}" in page.text
    assert "\n" not in repr(run) and "Δ 200 ms" in repr(run)


def test_a_sweep_has_qoc_beside_auc(study: Study) -> None:
    runs = study.sweep("gamma")
    assert runs["qoc"].dims == runs["auc"].dims and runs["qoc"].attrs["units"] == "1"
    np.testing.assert_array_equal(runs["qoc"].values, qoc(runs["auc"].values, study.scale).astype(np.float32))
    part = study.sweep("gamma")["qoc"].isel(gamma=1, deadline=[0, 2], seed=slice(3, 9))  # before all of it is read
    np.testing.assert_array_equal(part.values, runs["qoc"].values[1][[0, 2], 3:9])
    rows = study.results[study.results["sweep"] == "gamma"]
    np.testing.assert_allclose(runs["qoc"].mean(("seed", "robot")).values.ravel(), rows["qoc"], rtol=1e-6)


@pytest.mark.parametrize("command", ["tune", "codesign", "advise", "fleet", "qos", "validate"])
def test_what_other_commands_wrote_is_opened(command: str, tmp_path: Path) -> None:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        options = OmegaConf.to_container(compose(command), resolve=True)
    write_config(tmp_path, options)
    with pytest.raises(ValueError, match="got no record, expected the finished results of"):
        open_study(tmp_path)
    write_json(tmp_path / "record.json", {"chosen": {"kappa": 2.5, "deadline": 0.16}, "j_med": 1.25})
    with pytest.raises(ValueError, match="got no tables, expected the finished results of"):
        open_study(tmp_path)
    write_table(tmp_path / "designs", pd.DataFrame({"kappa": [1.0, 2.5], "note": ["a", "b"]}))
    found = open_study(tmp_path)
    assert isinstance(found, Results) and found.command == command
    assert found.record["chosen"] == {"kappa": 2.5, "deadline": 0.16} and found.configuration["key"] == 0
    pd.testing.assert_frame_equal(found.tables["designs"], pd.DataFrame({"kappa": [1.0, 2.5], "note": ["a", "b"]}))
    page = Words(found._repr_html_())
    assert page.open == [] and "designs (2 rows)" in page.text and "0.16" in page.text


@pytest.mark.parametrize("damage", ["record.json", "designs.csv"])
def test_damaged_results_are_named(damage: str, tmp_path: Path) -> None:
    write_config(tmp_path, {"tune": {}})
    write_json(tmp_path / "record.json", {})
    write_table(tmp_path / "designs", pd.DataFrame({"kappa": [1.0]}))
    (tmp_path / damage).write_bytes(b"")
    with pytest.raises(ValueError, match=f"{damage}: damaged"):
        open_study(tmp_path)


def test_a_deadline_beyond_the_horizon_is_refused() -> None:
    for deadline in (2.5, [0.1, 40.0]):
        with pytest.raises(ValueError, match="deadline: got .*, expected <= 2"):
            evaluate(SHORT, Design(tau=0.05, deadline=deadline), paper_network(), range(2))
    with pytest.raises(ValueError, match="deadline: got 2.5, expected <= 2"):
        replay(SHORT, Design(tau=0.05, deadline=2.5), paper_network(), 0)
