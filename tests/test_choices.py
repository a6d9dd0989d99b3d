"""The verdict on a conclusion, and what a study's page says of the choices that decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.choices import PACKAGED, RESULTS, packaged, with_flips
from experiments.conclusions import CONCLUSIONS
from experiments.verdicts import Finding, Part, ratio
from qocjax import Design, Rules, Scenario, kth_5g_network, one_at_a_time, paper_network
from qocjax.network import Edge, with_edge
from qocjax.report import study_page, write_study_report
from qocjax.report.html import escape
from qocjax.study.hanging import departures, hanging_of
from qocjax.study.problem import Problem
from qocjax.study.sweep import study_of

GRID = one_at_a_time(Design(), {"v_max": [0.4, 0.7], "kappa": [1.0, 2.0]}, [0.1, 0.8])
PROBLEM = Problem(Scenario(), GRID.designs, paper_network(), Rules(), 0)
SWEEPS = ["v_max", "kappa"]


def part(mean: float, spread: float, *, above: bool = True) -> Part:
    values = mean + spread * np.array([-1.0, 1.0] * 32)
    return Part("difference", values, "J*", 0.01, above)


def verdict(parts: Sequence[Part]) -> str:
    return Finding(list(parts)).verdict


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([part(0.1, 0.1)], "holds"),
        ([part(0.1, 0.1), part(0.01, 0.1)], "undecided"),
        ([part(0.1, 0.1), part(-0.1, 0.1)], "does not hold"),
        ([part(0.0, 0.0)], "does not hold"),  # they coincide
        ([part(0.002, 0.001)], "does not hold"),  # shown to differ, by less than counts
        ([part(0.1, 0.1, above=False)], "does not hold"),
        ([part(-0.1, 0.1, above=False)], "holds"),
    ],
)
def test_verdict_follows_the_intervals(parts: list[Part], expected: str) -> None:
    assert verdict(parts) == expected


def test_one_of_many_has_to_fail_more_clearly() -> None:
    low = part(-0.017, 0.1)  # beyond the bound at 95 %, but not at 99.2 %
    assert verdict([low]) == "does not hold"
    assert verdict([low, *[part(0.1, 0.1)] * 5]) == "undecided"


def test_interval_of_a_share_has_a_width_at_its_ends() -> None:
    none = Part("collisions", np.zeros(64, bool), "share", 0.05, above=False)
    assert none.interval().low == pytest.approx(0.0, abs=1e-12)
    assert none.interval().high == pytest.approx(0.0566, abs=1e-3)  # Wilson: z²/(n + z²)
    assert none.side() == 0


def test_ratio_has_the_spread_of_a_ratio_of_means() -> None:
    generator = np.random.default_rng(0)
    draws = generator.normal([3.0, 2.0], [0.3, 0.2], size=(4000, 64, 2))
    ratios = draws[..., 0].mean(axis=1) / draws[..., 1].mean(axis=1)
    values = ratio(draws[0, :, 0], draws[0, :, 1])
    assert values.mean() == pytest.approx(ratios[0])
    assert values.std(ddof=1) / 8 == pytest.approx(ratios.std(), rel=0.25)


def test_packaged_numbers_are_those_of_the_experiment() -> None:
    table = pd.read_csv(RESULTS / "choices.csv", dtype={"value": str}, keep_default_na=False)
    assert set(table["conclusion"]) == {each.number for each in CONCLUSIONS}
    again = with_flips(table.drop(columns="flips"))
    assert again["flips"].tolist() == table["flips"].tolist() and table["flips"].any()
    pd.testing.assert_frame_equal(packaged(table).reset_index(drop=True), pd.read_csv(PACKAGED, dtype={"value": str}))


def test_the_default_study_names_what_its_actuation_decides() -> None:
    found = hanging_of(PROBLEM, SWEEPS)
    beats = "“Co-design beats MaxRel in each sweep” rests on commands being held until t_p + Δ (loop.actuation)"
    assert beats in found.text
    choices = {choice for claim, choice, _ in found.numbers if claim == "Co-design beats MaxRel in each sweep"}
    assert choices == {"loop.actuation=arrival", "loop.actuation=instant"}
    swept = hanging_of(PROBLEM, [*SWEEPS, "gamma"])
    assert [any("γ" in claim for claim, _, _ in each.numbers) for each in (found, swept)] == [False, True]


def test_a_study_with_one_choice_changed_is_told_what_does_not_hold_there() -> None:
    found = hanging_of(replace(PROBLEM, rules=Rules(actuation="arrival")), SWEEPS)
    assert found.text.startswith("With loop.actuation=arrival, unlike with the default, ")
    assert "“Co-design beats MaxRel in each sweep” does not hold" in found.text
    assert {choice for _, choice, _ in found.numbers} == {"loop.actuation=arrival"}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, []),
        ({"rules": Rules("instant", "zero")}, [("loop.actuation", "instant"), ("loop.hold", "zero")]),
        ({"scenario": Scenario(reference="follow")}, [("scenario.reference.kind", "follow")]),
        ({"scenario": Scenario(start_jitter=(0.0, 0.0))}, [("scenario.start_jitter", "[0,0]")]),
        ({"network": with_edge(paper_network(), Edge(discipline="skip"))}, [("network.edge.discipline", "skip")]),
        ({"configuration": {"sweep": {"min_reliability": 0.1}}}, [("sweep.min_reliability", "0.1")]),
        ({"network": kth_5g_network()}, [("network", "kth_5g")]),
        ({"network": kth_5g_network(uplink_loss=0.1)}, None),
        ({"network": paper_network(0.1)}, None),
        ({"network": with_edge(paper_network(), Edge(workers=2, discipline="skip"))}, None),
        ({"scenario": Scenario(horizon=20.0)}, None),
        ({"rules": Rules(hold="timeout", hold_timeout=0.2)}, None),
        ({"scenario": Scenario(start_jitter=(0.1, 0.0))}, None),
        ({"configuration": {"sweep": {"j_med": 4.0, "j_max": 200.0}}}, None),
    ],
)
def test_departures_from_the_paper(changes: dict, expected: list[tuple[str, str]] | None) -> None:
    assert departures(replace(PROBLEM, **changes), SWEEPS) == expected


@pytest.mark.parametrize(
    ("baseline", "expected"), [({"d_safe": 0.3}, [("controller.d_safe", "0.3")]), ({"gamma": 4.0}, None)]
)
def test_departures_of_the_baseline(baseline: dict, expected: list[tuple[str, str]] | None) -> None:
    grid = one_at_a_time(Design(**baseline), {"v_max": [0.4, 0.7], "kappa": [1.0, 2.0]}, [0.1, 0.8])
    assert departures(replace(PROBLEM, designs=grid.designs), SWEEPS) == expected


def test_nothing_is_said_of_what_was_not_examined() -> None:
    for changes in ({"network": paper_network(0.1)}, {"rules": Rules("instant", "zero")}):
        assert hanging_of(replace(PROBLEM, **changes), SWEEPS) == ("", ())


def test_the_page_of_a_study_says_so(tmp_path: Path) -> None:
    page = study_page("small", study_of(PROBLEM, GRID, range(4), range(4, 8)), PROBLEM)
    html = write_study_report(tmp_path / "report.html", page).read_text(encoding="utf-8")
    found = hanging_of(PROBLEM, SWEEPS)
    assert escape(found.text) in html and all(escape(number) in html for _, _, number in found.numbers)
    other = replace(page, hanging=hanging_of(replace(PROBLEM, network=paper_network(0.1)), SWEEPS))
    html = write_study_report(tmp_path / "other.html", other).read_text(encoding="utf-8")
    assert "paper leaves open" not in html and "Not as with the default" not in html
