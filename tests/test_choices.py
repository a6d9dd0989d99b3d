"""The verdict on a conclusion, and what a study's page says of the choices that decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from experiments.choices import PACKAGED, RESULTS, packaged, with_flips
from experiments.conclusions import CONCLUSIONS, MODEL, SENTENCES
from experiments.min_delay import choices as min_delay_choices
from experiments.observations import UNTESTABLE
from experiments.observations import page as observations_page
from experiments.observations import table as observed
from experiments.settings import GRIDS, Bench, Setting
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
_CONTRADICTED = ("IV.2b", "ii.4", "iii.2", "vi.2", "vi.3")


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
        ([part(0.1, 0.1), part(-0.1, 0.1)], "contradicted"),
        ([part(0.0, 0.0)], "contradicted"),  # they coincide
        ([part(0.002, 0.001)], "contradicted"),  # shown to differ, by less than counts
        ([part(0.1, 0.1, above=False)], "contradicted"),
        ([part(-0.1, 0.1, above=False)], "holds"),
    ],
)
def test_verdict_follows_the_intervals(parts: list[Part], expected: str) -> None:
    assert verdict(parts) == expected


def test_one_of_many_has_to_fail_more_clearly() -> None:
    low = part(-0.017, 0.1)  # beyond the bound at 95 %, but not at 99.2 %
    assert verdict([low]) == "contradicted"
    assert verdict([low, *[part(0.1, 0.1)] * 5]) == "undecided"


def test_what_can_happen_has_to_happen_once() -> None:
    good, bad, open_ = part(0.1, 0.1), part(-0.1, 0.1), part(0.01, 0.1)
    verdicts = [Finding(parts, some=True).verdict for parts in ([good, bad], [bad, open_], [bad, bad])]
    assert verdicts == ["holds", "undecided", "contradicted"]
    assert Finding([bad, good], some=True).deciding is good and Finding([good, bad]).deciding is bad
    weak = part(0.037, 0.1)  # beyond the bound at 95 %, but not at 98.75 %: four chances to be right by accident
    assert [Finding([weak] + [bad] * k, some=True).verdict for k in (0, 3)] == ["holds", "undecided"]


def test_a_choice_has_no_interval() -> None:
    above, same = (Part("Δ", np.array(value), "ms", 0.0) for value in (80.0, 0.0))
    assert (above.text(), above.side(), same.side()) == ("Δ: +80 ms", 1, -1)
    assert verdict([above]) == "holds" and verdict([same, above]) == "contradicted"


def test_each_sentence_is_quoted_and_judged_or_has_its_reason() -> None:
    numbers = [each.number for each in (*SENTENCES, *MODEL)]
    assert len(set(numbers)) == len(numbers) and {each.number for each in CONCLUSIONS} <= set(numbers)
    untold = [each for each in SENTENCES if isinstance(each.test, str)]
    assert {each.number for each in SENTENCES} - {each.number for each in CONCLUSIONS} == {e.number for e in untold}
    with pytest.raises(TypeError, match="IV.1: needs the AUC that the paper measured"):
        next(each for each in untold if each.number == "IV.1").judge(None)  # type: ignore[arg-type]
    finding = Finding([part(0.1, 0.1)], "with a note")
    found = {edge: {each.number: finding for each in CONCLUSIONS} for edge in ("one", "two")}
    rows = observed(found, 64)
    assert list(dict.fromkeys(rows["number"])) == numbers
    assert len(rows) == 2 * len(CONCLUSIONS) + len(untold)
    assert set(rows.loc[rows["edge"].isna(), "verdict"]) == {UNTESTABLE}
    text = observations_page(found, 64)
    for each in SENTENCES:
        assert f"| {each.number} | {f'“{each.quote}”' if each.quote else each.claim} |" in text
    assert text.count("**holds**: difference: +10.0 [+7.5, +12.5] % of J\\* (with a note)") == 2 * len(CONCLUSIONS)


def test_committed_verdicts_follow_from_the_numbers_beside_them() -> None:
    table = pd.read_csv(RESULTS / "observations.csv", keep_default_na=False)
    said = {each.number: (each.quote, each.claim) for each in (*SENTENCES, *MODEL)}
    assert {number: said[number] for number in table["number"]} == said
    assert all(said[row.number] == (row.quote, row.claim) for row in table.itertuples())
    for (number, edge), rows in table[table["edge"] != ""].groupby(["number", "edge"]):
        sides, own = rows["side"].astype(int), rows["verdict"].iloc[0]
        right = np.where(rows["claimed"] == "above", rows["low"].astype(float) > rows["bound"].astype(float),
                         rows["high"].astype(float) < rows["bound"].astype(float))  # fmt: skip
        np.testing.assert_array_equal(sides == 1, right, err_msg=f"{number} {edge}")
        every = any if rows["enough"].iloc[0] == "one" else all
        if own == "holds":
            assert every(sides == 1), number
        elif own == "contradicted":
            assert (sides == -1).any() and not every(sides == 1), number


def test_min_delay_waits_as_long_as_it_is_told_to() -> None:
    """It takes the smallest deadline with the share that is asked for, and the best value there."""
    axis, shares = [0.0, 0.1, 0.14, 0.3], [0.0, 0.02, 0.11, 0.98]
    qoc = {1.0: [0.1, 0.2, 0.6, 0.5], 2.0: [0.1, 0.3, 0.5, 0.4]}
    rows = [{"sweep": sweep, "value": value, "deadline": deadline, "reliability": share, "qoc": score}
            for sweep in GRIDS for value, scores in qoc.items()
            for deadline, share, score in zip(axis, shares, scores, strict=True)]  # fmt: skip
    bench = SimpleNamespace(study=SimpleNamespace(results=pd.DataFrame(rows)))
    table = min_delay_choices(bench)  # type: ignore[arg-type]
    own = table[table["sweep"] == "kappa"].set_index("min_reliability")
    assert own["deadline"].to_dict() == {0.0: 0.0, 0.0001: 0.1, 0.001: 0.1, 0.01: 0.1, 0.02: 0.1, 0.05: 0.14, 0.1: 0.14,
                                         0.2: 0.3, 0.5: 0.3, 0.9: 0.3}  # fmt: skip
    assert own.loc[[0.01, 0.1], "value"].tolist() == [2.0, 1.0]
    few = pd.DataFrame(rows)[lambda table: table["deadline"] < 0.2]
    left = min_delay_choices(SimpleNamespace(study=SimpleNamespace(results=few)))  # type: ignore[arg-type]
    assert left["min_reliability"].max() == 0.1  # no deadline has more


@pytest.mark.slow
def test_what_the_paper_says_of_single_parameters_is_judged_as_it_was() -> None:
    """The sentences that the simulation contradicts by far, of few seeds."""
    bench = Bench(Setting(), 32)
    verdicts = {each.number: each.judge(bench).verdict for each in CONCLUSIONS if each.number in _CONTRADICTED}
    assert verdicts == dict.fromkeys(_CONTRADICTED, "contradicted")
    finding = next(each for each in CONCLUSIONS if each.number == "iii.2").judge(bench)
    assert finding.deciding.interval().mean > 5  # ten times as many samples take far more than a difference off


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
    beats = "“Co-design beats MaxRel, which is sluggish” rests on commands being held until t_p + Δ (loop.actuation)"
    assert beats in found.text
    choices = {choice for claim, choice, _ in found.numbers if claim == "Co-design is best, at an intermediate Δ"}
    assert choices == {"loop.actuation=arrival", "loop.actuation=instant"}
    assert "“Co-design beats MinDelay, which misses loops” rests on the F that MinDelay asks for" in found.text
    swept = hanging_of(PROBLEM, [*SWEEPS, "gamma"])
    assert [any("γ" in claim for claim, _, _ in each.numbers) for each in (found, swept)] == [False, True]


def test_a_study_with_one_choice_changed_is_told_what_does_not_hold_there() -> None:
    found = hanging_of(replace(PROBLEM, rules=Rules(actuation="arrival")), SWEEPS)
    assert found.text.startswith("With loop.actuation=arrival, unlike with the default, ")
    assert "“Co-design beats MaxRel, which is sluggish” is contradicted" in found.text
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
