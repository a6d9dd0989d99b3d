"""Several studies on one QoC scale, paired where they saw the same random numbers (model, sections 5 and 6)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from qocjax.quality import QocScale
from qocjax.statistics.estimates import Estimate, estimate, standard_error
from qocjax.statistics.scales import StudyScale, measured_scale
from qocjax.statistics.scores import Scored, Scores, seed_scores, unpaired_scores
from qocjax.statistics.units import units_in
from qocjax.study.axes import axes_of, is_joint
from qocjax.study.chosen import design_of, place_of
from qocjax.study.study import Study
from qocjax.study.table import names_in

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Comparison", "compare"]

# What an AUC is made of: without the same here it is another quantity. And what else makes runs see the same.
_YARDSTICK = ("horizon", "reference", "normaliser", "weights")
_SAME_RUNS = ("start", "goal", "start_jitter", "map")
_APART = 1 << 40  # between the labels of seeds that have nothing in common
_BLOCK = 1 << 20  # AUC values that are held at once
_NOTHING = Estimate(np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Comparison:
    """What a comparison found."""

    table: pd.DataFrame  # a row per study, sweep and policy
    curves: pd.DataFrame  # a row per study, sweep and deadline: the best value's QoC on the selection seeds
    scale: QocScale  # of all selection runs of all studies
    notes: list[str]  # what a reader should know, a sentence each


@dataclass(frozen=True)
class _Choice:
    """A policy's choice in a sweep."""

    row: dict[str, Any]  # of the study's policies
    score: Scores  # [S] on the common scale
    auc: np.ndarray  # [S] s


@dataclass(frozen=True)
class _Judged:
    """A study's choices on its evaluation seeds."""

    name: str
    seeds: np.ndarray  # [S]
    units: np.ndarray  # [S] labels of what counts as one observation
    choices: dict[tuple[str, str], _Choice]  # by sweep and policy

    def pairs_with(self, other: _Judged) -> bool:
        """Whether common seeds are common observations."""
        _, at, there = np.intersect1d(self.seeds, other.seeds, return_indices=True)
        return np.array_equal(self.units[at], other.units[there])


def compare(studies: Mapping[str, Study]) -> Comparison:
    """Puts studies on the QoC scale of all their runs; differences are to the first study.

    Each study's policies keep the designs that they chose on their own scale. A difference is paired over the
    evaluation seeds that both have, where key, starts and goals are the same; else the intervals are those of
    independent runs, and a note says why.

    Args:
        studies: By name; made from configurations, so that what they simulated can be told.

    Raises:
        ValueError: Fewer than two, or AUC that cannot be compared: another horizon, reference, normaliser or weights.
    """
    if len(studies) < 2:
        raise ValueError(f"studies: got {len(studies)}, expected at least two to compare")
    first, *others = list(studies)
    options = {name: _options(name, study) for name, study in studies.items()}
    for name in others:
        _check_yardstick(first, options[first], name, options[name])
    reasons = {name: _unpaired_because(options[first], options[name]) for name in others}
    scale = _common_scale(studies, reasons)
    judged = {name: _judged(name, study, scale) for name, study in studies.items()}
    rows = [row for name in studies for row in _rows(judged[name], judged[first], not reasons.get(name))]
    curves = pd.concat([_curves(name, study, scale) for name, study in studies.items()], ignore_index=True)
    return Comparison(pd.DataFrame(rows), curves, scale, list(_notes(judged, first, reasons)))


def _common_scale(studies: Mapping[str, Study], reasons: Mapping[str, str]) -> StudyScale:
    """J_med of all selection runs, with its error; seeds that two studies both have count as one where paired.

    What J_max is, each study says: robots that never move cost the same in all, the largest run of each another.
    """
    kind = np.result_type(*(study.runs["auc"].dtype for study in studies.values()))
    ends = np.cumsum([0, *(study.runs.sizes["seed"] for study in studies.values())]).tolist()
    apart = [place * _APART if reasons.get(name) else 0 for place, name in enumerate(studies)]
    labels = [units_in(study.runs) for study in studies.values()]
    # Stretches of a trace stay what they are, whichever seeds take them.
    units = [np.where(each < 0, each, each + by) for each, by in zip(labels, apart, strict=True)]

    def parts() -> Iterator[tuple[slice, np.ndarray]]:
        for begin, end, study in zip(ends, ends[1:], studies.values(), strict=False):
            yield from ((slice(begin, end), auc.astype(kind)) for auc in _auc_blocks(study.runs))

    return measured_scale(parts, np.concatenate(units), max(study.scale.largest for study in studies.values()))


def _options(name: str, study: Study) -> Mapping[str, Any]:
    if study.configuration is None:
        raise ValueError(f"studies: got {name} without its configuration, expected one that says what was simulated")
    return study.configuration


def _check_yardstick(first: str, one: Mapping[str, Any], name: str, other: Mapping[str, Any]) -> None:
    for key in _YARDSTICK:
        a, b = one["scenario"][key], other["scenario"][key]
        if a != b:
            raise ValueError(
                f"studies: got scenario.{key} {_text(a)} in {first} and {_text(b)} in {name}, expected the same: "
                "their AUC cannot be compared"
            )


def _unpaired_because(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Why two studies did not see the same random numbers; empty if they did."""
    if one["key"] != other["key"]:
        return f"key {one['key']} and {other['key']}"
    for key in _SAME_RUNS:
        a, b = one["scenario"].get(key), other["scenario"].get(key)
        if a != b:
            return f"scenario.{key} {_text(a)} and {_text(b)}"
    return ""


def _text(value: Any) -> str:
    """An option as it is written on the command line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name}: {_text(each)}" for name, each in value.items()) + "}"
    return "null" if value is None else str(value)


def _auc_blocks(runs: xr.Dataset) -> Iterator[np.ndarray]:
    """AUC [some designs, S, N] of all runs."""
    designs = max(1, _BLOCK // (runs.sizes["seed"] * runs.sizes["robot"]))
    for begin in range(0, runs.sizes["design"], designs):
        yield runs["auc"].isel(design=slice(begin, begin + designs)).values


def _judged(name: str, study: Study, scale: QocScale) -> _Judged:
    """What the policies of a study reach on the common scale; without those that found no design."""
    choices, runs = {}, study.evaluation
    for row in study.policies[study.policies["qoc"].notna()].to_dict("records"):
        auc = runs["auc"].isel(design=place_of(runs, design_of(study.results, row))).values.astype(np.float64)
        choices[str(row["sweep"]), str(row["policy"])] = _Choice(
            row, Scores.of(auc, scale, units_in(runs)), auc.mean(axis=-1)
        )
    return _Judged(name, runs["seed"].values, units_in(runs), choices)


def _rows(judged: _Judged, reference: _Judged, together: bool) -> Iterator[dict[str, Any]]:
    for key, choice in judged.choices.items():
        row, cost = choice.row, estimate(choice.auc, units=choice.score.units)
        gap, is_paired = Scored(_NOTHING, _NOTHING), False
        if key in reference.choices and judged is not reference:
            gap, is_paired = _gap(judged, reference, key, together)
        yield {
            "study": judged.name, "sweep": key[0], "policy": key[1], "value": row["value"],
            **{axis: row[axis] for axis in axes_of(key[0]) if axis in row},
            "deadline": row["deadline"], "reliability": row["reliability"], **choice.score.mean().columns("qoc"),
            "qoc_own_scale": row["qoc"], "auc": cost.mean, "auc_se": cost.se,
            **gap.columns("difference"), "paired": is_paired,
            **{name: row.get(name, np.nan) for name in ("collision_share", "collision_low", "collision_high")},
            "within_limit": bool(row.get("within_limit", True)),
            "seeds": len(judged.seeds),
        }  # fmt: skip


def _gap(judged: _Judged, reference: _Judged, key: tuple[str, str], together: bool) -> tuple[Scored, bool]:
    """Difference to the reference, and whether it is paired: on common seeds, of common stretches of a trace."""
    here, there = judged.choices[key].score, reference.choices[key].score
    _, at, at_reference = np.intersect1d(judged.seeds, reference.seeds, return_indices=True)
    if together and at.size >= 2 and judged.pairs_with(reference):
        own, other = here.on(at), there.on(at_reference)
        return (own - other).mean(), True
    return unpaired_scores(here, there), False


def _curves(name: str, study: Study, scale: QocScale) -> pd.DataFrame:
    """QoC of the best value at each deadline of each sweep, on the seeds of the choice."""
    runs = study.runs
    scores = np.concatenate([seed_scores(part, scale) for part in _auc_blocks(runs)])
    names = names_in(runs)
    designs = pd.DataFrame({each: runs[each].values for each in names})
    designs["qoc"], designs["qoc_se"] = scores.mean(axis=1), standard_error(scores, units=units_in(runs))
    rows = study.results[["sweep", "value", "reliability", *names]].merge(designs, on=names, how="left")
    axes = list(dict.fromkeys(axis for sweep in rows["sweep"].unique() for axis in axes_of(sweep) if is_joint(sweep)))
    best = rows.dropna(subset=["qoc"]).groupby(["sweep", "deadline"], sort=False)["qoc"].idxmax()
    kept = rows.loc[best, ["sweep", "deadline", "value", *axes, "reliability", "qoc", "qoc_se"]].reset_index(drop=True)
    kept.insert(0, "study", name)
    return kept


def _notes(studies: Mapping[str, _Judged], first: str, reasons: Mapping[str, str]) -> Iterator[str]:
    """What a reader should know of the pairing, and of sweeps that only some have."""
    reference = studies[first]
    for name, reason in reasons.items():
        judged = studies[name]
        common = np.intersect1d(judged.seeds, reference.seeds).size
        if reason:
            yield f"{name} is not paired with {first}: {reason}."
        elif common < 2:
            yield f"{name} is not paired with {first}: {common} evaluation seeds in common."
        elif not judged.pairs_with(reference):
            yield f"{name} is not paired with {first}: on the same seeds they replay other stretches of a trace."
        elif common < max(judged.seeds.size, reference.seeds.size):
            yield f"{name} is paired with {first} on the {common} evaluation seeds that both have."
        for lacking, holding in ((judged, reference), (reference, judged)):
            have, lack = ({sweep for sweep, _ in each.choices} for each in (holding, lacking))
            if have - lack:
                yield f"{lacking.name} has no sweep of {', '.join(sorted(have - lack))}, which {holding.name} has."
